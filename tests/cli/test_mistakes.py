"""What the user mistyped is told in one line, before anything is written."""

import contextlib

import pytest
from pages_for_tests import ROOT

from ge_torchrl.__main__ import main
from ge_torchrl.errors import EnvironmentFaultError

CONF = ROOT / "conf"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["env=foo"],
            "env=foo is unknown; expected one of acrobot, cartpole, default, flappybird, lunarlander, ",
        ),
        (["experiment=foo"], "experiment=foo is unknown; expected one of thesis/acrobot, thesis/cartpole, "),
        (["experiment=thesis/foo"], "experiment=thesis/foo is unknown; expected one of thesis/acrobot, "),
        (["hydra/launcher=foo"], "hydra/launcher=foo is unknown; expected one of basic"),
        (["env=5"], "env must be one of acrobot, cartpole, default, flappybird, lunarlander, "),
        (["polish=null"], "polish must be one of none; got null"),
        (["ge=null"], "ge must be a section with keys and values; got None"),
        (["ge=mountaincar"], "ge is no choice of files any more; expected env=NAME, which brings its"),
        (["hall_of_fame=none"], "hall_of_fame is no choice of files any more; expected archive=none, or"),
        (["archive=explored"], "archive=explored is gone, because a run keeps trees unless archive=none"),
        (
            ["-m", "evaluation=cartpole,acrobot"],
            "evaluation is no choice of files any more; expected env=NAME",
        ),
        (
            ["grammar=cartpole"],
            "grammar=cartpole is unknown; expected one of thesis/acrobot, thesis/cartpole, ",
        ),
        (["hall_of_fame.keep=5"], "hall_of_fame.keep is now archive.keep; "),
        (["refiner.cmaes.moves=5"], "refiner.cmaes.moves is now polish.moves; "),
        (
            ["env.route=compiled"],
            "env.route must be one of auto, kernel, gymnasium; got 'compiled'; compiled is now",
        ),
        (["env=default"], "env.id has no value; expected a Gymnasium id such as CartPole-v1; got nothing"),
        (
            ["ge.populaton_size=3"],
            "ge.populaton_size is unknown; expected a key of a run, such as ge.population_size",
        ),
        (["+ge.foo=3"], "ge.foo is unknown"),
        (["foo=1"], "foo is unknown"),
        (["foo/bar=1"], "Could not override 'foo/bar'"),
        (["ge.population_size=1"], "ge.population_size must be an integer of at least 2 or null, because"),
        (["ge.population_size=abc"], "ge.population_size must be an integer of at least 2 or null, because"),
        (["ge.gene_probability=true"], "ge.gene_probability must be a number from 0 to 1"),
        (["env.id=???"], "env.id has no value"),
        (["seed=${foo}"], "Interpolation key 'foo' not found full_key: seed"),
        (["seed=-1", "--cfg", "job"], "seed must be an integer of at least 0"),
        (["seed"], "expected key=value, such as seed=3; got 'seed'"),
        (["plant.py:Cart"], "expected key=value; got 'plant.py:Cart'; type env.dynamics=plant.py:Cart"),
        (["plant.py"], "expected key=value; got 'plant.py'; type env.dynamics=plant.py:Class, with the name"),
        (["CartPole-v1"], "expected key=value; got 'CartPole-v1'; type env.id=CartPole-v1"),
        (["ALE/Pong-v5"], "expected key=value; got 'ALE/Pong-v5'; type env.id=ALE/Pong-v5"),
        (["my_module:Name-v0"], "expected key=value; got 'my_module:Name-v0'; type env.id=my_module:Name-v0"),
        (["mountaincar"], "expected key=value; got 'mountaincar'; type env=mountaincar"),
        (
            ["env.wrappers=[gymnasium.wrappers:DiscretizeAction {bins: 3}]"],
            "the value of env.wrappers cannot be read, because a wrapper with arguments needs quotes of its own",
        ),
        (
            ["grammar.name=a b {"],
            "the value of grammar.name cannot be read; expected it in quotes, as in grammar.name='\"a b",
        ),
        (
            ["env.dynamics="],
            "env.dynamics must be a file and a class in it, such as plant.py:Cart or null; got ''",
        ),
        (
            ["env=cartpole", "env.kwargs.TRACK=inf"],
            "env.kwargs must be keys with values, such as {gravity: -5}; got {'TRACK': inf}; numbers must be finite",
        ),
        (
            ["env.symmetry={negate: [x], actions: [left, right]}"],
            "expected a list where one belongs, and keys with values where these do; got env.symmetry={negate: [x], ",
        ),
        (
            ["env=cartpole", "env.symmetry=x"],
            "env.symmetry must be keys with values, such as {negate: [x], actions: {left: right}} or null; got 'x'",
        ),
        (["ge=[1]"], "expected a list where one belongs, and keys with values where these do; got ge=[1]"),
        (
            ["env.features={a: b}"],
            "expected a list where one belongs, and keys with values where these do; got env.features={a: b}",
        ),
        (["seed=1,2"], "seed must be one value; got seed=1,2; for a run of each, add -m"),
        (["-m", "seed=1,-2"], "seed must be an integer of at least 0, because"),
        (["-m", "env=cartpole,foo"], "env=foo is unknown"),
        (
            ["-m", "ge.tournament_size=2,5", "ge.population_size=10,4"],
            "ge.tournament_size must be at most ge.population_size, 4, because a tournament draws",
        ),
        (
            ["ge.population_size=1e9"],
            "ge.population_size must be at most 21474836 with ge.genotype_length=100",
        ),
        (["hydra.job.chdir=maybe"], "Error merging override hydra.job.chdir=maybe"),
        (["--foo"], "--foo is an unknown flag"),
        (["--cgf", "job"], "--cgf is an unknown flag; expected one that --help names; did you mean --cfg?"),
        (["--cfg", "foo"], "argument --cfg/-c: invalid choice: 'foo'"),
        (["--cfg", "job", "-m"], "Only one of --run, --multirun, --cfg"),
        (["seed=1", "-m", "env=cartpole"], "env=cartpole stands apart"),
        (["--config-dir", "nowhere"], "--config-dir must be a folder with choices; got nowhere"),
        (
            ["--config-dir", str(CONF)],
            "--config-dir must be a folder with choices alone, because its config.yaml",
        ),
        (
            ["experiment=thesis/cartpole", "env=acrobot"],
            "experiment=thesis/cartpole fixes the environment, CartPole-v1, so expected no other one; got env=acrobot",
        ),
        (
            ["-m", "env=cartpole,acrobot", "experiment=thesis/cartpole"],
            "experiment=thesis/cartpole fixes the environment, CartPole-v1, so expected no other one; got env=acrobot",
        ),
        (
            ["hydra.run.dir="],
            "hydra.run.dir must be a folder, because a run leaves its files there; got hydra.run.dir=",
        ),
        (["-m", "hydra.sweep.dir=''"], "hydra.sweep.dir must be a folder, because a run leaves its files"),
        (["hydra.run.dir=null"], "hydra.run.dir must be a folder, because a run leaves its files there; got"),
        (
            ["evalute", "x"],
            "evalute is unknown; expected a command, or key=value, such as seed=3; got 'evalute'; did you mean",
        ),
        (
            ["reports"],
            "reports is unknown; expected a command, or key=value, such as seed=3; got 'reports'; did ",
        ),
        (
            ["train"],
            "expected key=value, such as seed=3; got 'train'; ge-torchrl help lists commands and keys",
        ),
        (
            ["help", "expot"],
            "expot is unknown; expected a command, or key=value, such as seed=3; got 'expot'; did",
        ),
        (["cartpol"], "expected key=value; got 'cartpol'; type env=cartpole"),
        (["evaluate"], "the following arguments are required: TREE_OR_RUN"),
        (
            ["evaluate", "tree", "--episodes", "0"],
            "argument --episodes: must be an integer from 1 to 1000000; got 0",
        ),
        (
            ["evaluate", "tree", "--seed", "x"],
            "argument --seed: must be an integer from 0 to 4611686018427387904; got x",
        ),
        (["evaluate", "tree", "--route", "x"], "argument --route: invalid choice: 'x'"),
        (["evaluate", "run", "--nodes", "-1"], "argument --nodes: must be an integer of at least 0; got -1"),
        (["evaluate", "tree", "--foo"], "unrecognized arguments: --foo"),
        (
            ["evaluate", "tree", "--json", "--markdown"],
            "argument --markdown: not allowed with argument --json",
        ),
        (
            ["evaluate", "tree", "--markdown"],
            "--markdown tells of many runs, so expected a folder above them; got tree",
        ),
        (["evaluate", "missing"], "missing must be a tree's file; got none"),
    ],
)
def test_mistake_is_one_line_and_writes_nothing(experiment, tmp_path, capsys, arguments, message):
    assert main(arguments) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith(f"ge-torchrl: {message}")
    assert printed.err.count("\n") == 1
    assert printed.out == ""
    assert experiment.runs == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("experiment")
@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("env=cartpol", "did you mean cartpole?"),
        ("env=lunarlandr", "did you mean lunarlander?"),
        ("env=CartPole-v1", "an id is typed env.id=CartPole-v1"),
        ("refiner=pppo", "did you mean ppo?"),
        ("grammar=cartpole", "did you mean thesis/cartpole?"),
        ("grammar.splits=obliqe", "did you mean oblique?"),
        ("env.route=Kernel", "did you mean kernel?"),
        ("refiner.ppo.optimizer=adm", "did you mean adam?"),
    ],
)
def test_the_nearest_name_is_asked_for(capsys, typed, meant):
    assert main([typed]) == 2
    assert capsys.readouterr().err.endswith(f"; {meant}\n")


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        (["help"], "ge-torchrl export"),
        (["help", "export"], "usage: ge-torchrl export"),
        (["help", "help"], "ge-torchrl export"),
    ],
)
def test_help_is_a_word_too(capsys, words, shown):
    with contextlib.suppress(SystemExit):
        assert main(words) == 0
    assert shown in capsys.readouterr().out


@pytest.mark.parametrize(("folder", "reason"), [("afile", "File exists"), ("afile/run", "Not a directory")])
def test_output_folder_that_cannot_be_made_is_one_line(experiment, tmp_path, capsys, folder, reason):
    (tmp_path / "afile").write_text("a file stands where the folder should be")
    for mode, key in (([], "hydra.run.dir"), (["-m"], "hydra.sweep.dir")):
        assert main([*mode, f"{key}={folder}"]) == 2
        told = capsys.readouterr().err
        assert told.startswith(
            f"ge-torchrl: {key} must be a folder that can be made, because a run leaves its"
        )
        assert told.endswith(f"({reason})\n")
        assert f"got {tmp_path / folder}" in told or f"got {folder}" in told
        assert told.count("\n") == 1
    assert experiment.runs == []


def test_error_that_the_user_can_mend_is_one_line(experiment, capsys):
    experiment.failures[0] = EnvironmentFaultError("env.id must be known; got Foo-v0")
    assert main([]) == 2
    assert capsys.readouterr().err == "ge-torchrl: env.id must be known; got Foo-v0\n"


def test_an_unknown_environment_is_told_before_anything_is_written(experiment, capsys, tmp_path):
    assert main(["env.id=MissingLink-v3"]) == 2
    assert "got MissingLink-v3" in capsys.readouterr().err
    assert main(["-m", "env.id=CartPole-v1,MissingLink-v3"]) == 2
    assert not experiment.runs
    assert not list(tmp_path.iterdir())
