"""`check`, `init`, and an id without a file."""

import os
import subprocess
import sys
import time

import pytest

from ge_torchrl.__main__ import main
from ge_torchrl.cli import waiting
from ge_torchrl.run import surveying

OWN = """
import gymnasium as gym
from environments_for_tests import CountdownEnv

gym.register("Own-v0", entry_point=CountdownEnv)
"""


@pytest.fixture
def surveyed(monkeypatch):
    """Stand in for looking at an environment; what was asked for."""
    asked = []

    class Found:
        def as_text(self):
            return "what was found"

    def survey(config):
        asked.append(config)
        return Found()

    monkeypatch.setattr(surveying, "survey", survey)
    return asked


def test_check_takes_an_id_or_a_choice_with_other_settings(surveyed, capsys):
    assert main(["check", "LunarLander-v3", "env.kwargs.gravity=-5"]) == 0
    assert main(["check", "env=mountaincar"]) == 0
    assert capsys.readouterr().out == "what was found\n" * 2
    lander, hill = surveyed
    assert (lander.env.id, lander.env.features[0], lander.env.kwargs) == (
        "LunarLander-v3", "x", {"gravity": -5}
    )  # fmt: skip
    assert (hill.env.id, hill.env.features) == ("MountainCar-v0", ("position", "velocity"))


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["check"], "the following arguments are required: ENV; see --help"),
        (["check", "env=nothing"], "env=nothing is unknown; expected one of"),
        (["check", "A-v0", "env.foo=3"], "env.foo is unknown"),
        (["check", "NoSuchThing-v0"], "env.id must be the id of an installed Gymnasium environment"),
        (
            ["check", "plant.py"],
            "env.dynamics must be a file and a class in it, as in env.dynamics=plant.py:Class",
        ),
        (["init", "FrozenLake-v1"], "env.wrappers='[gymnasium.wrappers:FlattenObservation]'"),
        (
            ["chek", "A-v0"],
            "chek is unknown; expected a command, or key=value, such as seed=3; got 'chek'; did you mean check?",
        ),
    ],
)
def test_mistakes_are_one_line(arguments, told, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("verb", ["check", "init"])
def test_help_is_there(verb, capsys):
    with pytest.raises(SystemExit) as left:
        main([verb, "--help"])
    assert left.value.code == 0
    assert "Gymnasium id" in capsys.readouterr().out


def test_what_init_writes_composes_by_the_command_that_it_prints(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["init", "MountainCar-v0", "--out", "own conf"]) == 0
    first, command = capsys.readouterr().out.splitlines()
    assert "my_mountaincar.yaml" in first
    assert command == "  python -m ge_torchrl --config-dir 'own conf' env=my_mountaincar"
    assert main(["--config-dir", "own conf", "env=my_mountaincar", "--cfg", "job"]) == 0
    assert "lt(position, " in capsys.readouterr().out
    assert main(["init", "MountainCar-v0", "--out", "own conf"]) == 2
    assert "is there already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "features"),
    [
        (["env.id=MountainCar-v0"], ("position", "velocity")),
        (["seed=3", "env.id='MountainCar-v0'", "ge.generations=3"], ("position", "velocity")),
        (["+env.id=MountainCar-v0"], ("position", "velocity")),
        (["env=mountaincar", "env.id=MountainCar-v0"], ("position", "velocity")),
        (["env=default", "env.id=MountainCar-v0"], ()),
        (["env.id=CartPole-v1"], ("x", "x_dot", "theta", "theta_dot")),
        (["env.id=CartPole-v0"], ()),
    ],
)
def test_an_id_takes_the_file_that_names_it_and_no_other(words, features, experiment, capsys):
    assert main(words) == 0
    ((config, _),) = experiment.runs
    assert config.env.features == features
    assert (config.grammar.bnf is None) == (features == ())
    told = capsys.readouterr().err
    is_chosen = features != () and not any(word.startswith("env=") for word in words)
    assert ("takes names, grammar and settings of env=" in told) == is_chosen


def test_ids_are_swept_over(experiment, capsys):
    assert main(["-m", "env.id=CartPole-v1,Acrobot-v1"]) == 0
    assert [(config.env.id, config.env.features) for config, _ in experiment.runs] == [
        ("CartPole-v1", ()),
        ("Acrobot-v1", ()),
    ]
    assert "env=cartpole and env=acrobot would" in capsys.readouterr().err


def test_an_experiment_keeps_its_environment(experiment, capsys):
    assert main(["experiment=thesis/cartpole", "env.id=Acrobot-v1"]) == 2
    assert "fixes the environment, CartPole-v1, so expected no other one" in capsys.readouterr().err
    assert main(["experiment=thesis/cartpole", "env.id=CartPole-v1"]) == 0
    assert len(experiment.runs) == 1


def test_the_console_script_finds_modules_of_the_current_folder(tmp_path):
    (tmp_path / "own_module.py").write_text(OWN)
    script = "import sys; from ge_torchrl.program import main; sys.path.remove(''); sys.exit(main())"
    found = subprocess.run(
        [sys.executable, "-c", script, "check", "own_module:Own-v0"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert found.stderr == ""
    assert found.stdout.startswith("own_module:Own-v0\n")


@pytest.mark.usefixtures("surveyed")
def test_an_environment_that_takes_its_time_is_named_meanwhile(capsys, monkeypatch):
    monkeypatch.setattr(waiting, "_SILENCE_SECONDS", 0.0)
    quick = surveying.survey

    def slow(config):
        time.sleep(0.3)
        return quick(config)

    monkeypatch.setattr(surveying, "survey", slow)
    assert main(["check", "env=cartpole"]) == 0
    assert capsys.readouterr().err == "ge-torchrl: looking at CartPole-v1 ...\n"
