import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from pages_for_tests import ROOT

import ge_torchrl
from ge_torchrl import __main__ as command_line
from ge_torchrl.__main__ import main
from ge_torchrl.artefacts.folder import CONFIG, RunFolder
from ge_torchrl.errors import EnvironmentFaultError, RunFaultError

CONF = ROOT / "conf"


def test_each_run_has_a_folder_of_its_own_and_nothing_else_is_written(experiment, tmp_path):
    for _ in range(3):
        assert main(["seed=4"]) == 0
    folders = [output_dir for _, output_dir in experiment.runs]
    assert len(set(folders)) == 3
    assert all(folder.parent == tmp_path / "outputs" / "cartpole" for folder in folders)
    assert all(folder.name.endswith("-seed4") and folder.is_dir() for folder in folders)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_sweep_runs_all_combinations_in_folders_that_name_them(experiment):
    assert main(["-m", "seed=range(0,2)", "env=cartpole,acrobot"]) == 0
    runs = [(folder.name, config.env.id, config.seed) for config, folder in experiment.runs]
    assert runs == [
        ("0_env=cartpole,seed=0", "CartPole-v1", 0),
        ("1_env=acrobot,seed=0", "Acrobot-v1", 0),
        ("2_env=cartpole,seed=1", "CartPole-v1", 1),
        ("3_env=acrobot,seed=1", "Acrobot-v1", 1),
    ]


def test_the_name_of_a_job_with_many_overrides_is_cut(experiment):
    many = [
        f"refiner.ppo.{key}=0.001"
        for key in ("lr_actor", "lr_critic", "gae_lambda", "entropy_coeff", "clip_epsilon")
    ]
    many += ["refiner.ppo.update_timesteps=1000", "evaluation.validation_episodes=50", "ge.generations=3"]
    assert main(["-m", "seed=0,1", *many]) == 0
    names = [folder.name for _, folder in experiment.runs]
    assert [name[:2] for name in names] == ["0_", "1_"]
    assert all(len(name) < 200 and name.endswith("...") for name in names)


def test_sweep_over_the_same_value_twice_and_over_paths_keeps_jobs_apart(experiment):
    assert main(["-m", "seed=1,1", "experiment=thesis/cartpole"]) == 0
    names = [folder.name for _, folder in experiment.runs]
    assert names == ["0_seed=1", "1_seed=1"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["env=foo"],
            "env=foo is unknown; expected one of acrobot, cartpole, default, lunarlander, mountaincar; got foo",
        ),
        (["experiment=foo"], "experiment=foo is unknown; expected one of thesis/acrobot, thesis/cartpole, "),
        (["experiment=thesis/foo"], "experiment=thesis/foo is unknown; expected one of thesis/acrobot, "),
        (["hydra/launcher=foo"], "hydra/launcher=foo is unknown; expected one of basic"),
        (["env=5"], "env must be one of acrobot, cartpole, default, lunarlander, mountaincar; got 5"),
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
        (["env=default", "env.id=A-v0"], "grammar.bnf has no value; expected rules in Backus-Naur form"),
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
            "evalute is unknown; expected key=value, such as seed=3, or evaluate; got 'evalute'",
        ),
        (["reports"], "reports is unknown; expected key=value, such as seed=3, or report; got 'reports'"),
        (["evaluate"], "the following arguments are required: TREE_OR_RUN"),
        (
            ["evaluate", "tree", "--episodes", "0"],
            "argument --episodes: must be an integer from 1 to 1000000; got 0",
        ),
        (["evaluate", "tree", "--seed", "x"], "argument --seed: must be an integer of at least 0; got x"),
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


def test_an_experiment_may_stand_beside_its_own_environment(experiment):
    assert main(["experiment=thesis/acrobot", "env=acrobot"]) == 0
    assert [config.env.id for config, _ in experiment.runs] == ["Acrobot-v1"]


def test_the_configuration_of_a_run_is_read_again_as_readme_says(experiment, tmp_path):
    assert main(["env=mountaincar", "seed=7", "ge.generations=9"]) == 0
    given, _ = experiment.runs[0]
    RunFolder.create(tmp_path / "RUN", given)
    form = f"--config-path $PWD/RUN --config-name {Path(CONFIG).stem}"
    assert form in (ROOT / "README.md").read_text()
    assert main(form.replace("$PWD", str(tmp_path)).split()) == 0
    assert experiment.runs[1][0] == given


def test_error_that_the_user_can_mend_is_one_line(experiment, capsys):
    experiment.failures[0] = EnvironmentFaultError("env.id must be known; got Foo-v0")
    assert main([]) == 2
    assert capsys.readouterr().err == "ge-torchrl: env.id must be known; got Foo-v0\n"


def test_run_that_broke_off_is_one_line_and_a_fault(experiment, capsys):
    experiment.failures[0] = RunFaultError(
        "the run broke off (ZeroDivisionError: a bug); the best tree so far is in x"
    )
    assert main([]) == 1
    assert capsys.readouterr().err == f"ge-torchrl: {experiment.failures[0]}\n"


def test_fault_of_the_program_shows_its_traceback_without_hydras_frames(experiment, capsys):
    experiment.failures[0] = ZeroDivisionError("a bug")
    assert main([]) == 1
    shown = capsys.readouterr().err
    assert shown.startswith("Traceback")
    assert shown.endswith("ZeroDivisionError: a bug\n")
    assert "hydra" not in shown.replace("HydraConfig", "").lower()


def test_failing_job_does_not_stop_a_sweep_but_the_status_tells(experiment):
    experiment.failures[1] = EnvironmentFaultError("env.id must be known; got Foo-v0")
    assert main(["-m", "seed=0,1,2"]) == 2
    assert [config.seed for config, _ in experiment.runs] == [0, 1, 2]
    experiment.failures[2] = ZeroDivisionError("a bug")
    assert main(["-m", "seed=0,1,2,3"]) == 1
    assert [config.seed for config, _ in experiment.runs] == [0, 1, 2, 0, 1, 2, 3]


def test_interrupt_ends_everything_quietly(experiment, capsys):
    experiment.failures[1] = KeyboardInterrupt()
    assert main(["-m", "seed=0,1,2"]) == 130
    assert [config.seed for config, _ in experiment.runs] == [0, 1]
    assert capsys.readouterr().err == ""


@pytest.mark.usefixtures("experiment")
def test_command_line_leaves_the_process_as_it_was(monkeypatch):
    monkeypatch.delenv("HYDRA_FULL_ERROR", raising=False)
    before = list(sys.argv)
    assert main(["seed=1"]) == 0
    assert sys.argv == before
    assert "HYDRA_FULL_ERROR" not in command_line.os.environ


def test_evaluate_measures_a_tree(experiment, capsys):
    assert main(["evaluate", "runs/tree.json"]) == 0
    assert capsys.readouterr().out == "mean return 499.5\n"
    assert main(["evaluate", "t", "--episodes", "5", "--seed", "1", "--route", "kernel", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"mean": 499.5}
    assert main(["evaluate", "run", "--nodes", "3"]) == 0
    assert experiment.evaluated == [
        (Path("runs/tree.json"), 1000, 10000, "auto", None),
        (Path("t"), 5, 1, "kernel", None),
        (Path("run"), 1000, 10000, "auto", 3),
    ]


def test_evaluate_measures_the_trees_of_many_runs(experiment, tmp_path, capsys):
    (tmp_path / "multirun").mkdir()
    assert main(["evaluate", "multirun", "--episodes", "10", "--seed", "7"]) == 0
    printed = capsys.readouterr()
    assert printed.out == "a table\n"
    assert printed.err == "ge-torchrl: left out: multirun/3: broken\n"
    assert main(["evaluate", "multirun", "--markdown", "--nodes", "3"]) == 0
    assert capsys.readouterr().out == "| a table |\n"
    assert main(["evaluate", "multirun", "--json", "--route", "kernel"]) == 0
    assert json.loads(capsys.readouterr().out) == {"episodes": 10}
    assert experiment.evaluated == [
        (Path("multirun"), 10, 7, "auto", None),
        (Path("multirun"), 1000, 10000, "auto", 3),
        (Path("multirun"), 1000, 10000, "kernel", None),
    ]


@pytest.mark.parametrize(
    ("arguments", "shown"),
    [
        (["--help"], "experiment=thesis/cartpole"),
        (["--hydra-help"], "--multirun"),
        (["--cfg", "job", "seed=5"], "seed: 5"),
        (["--cfg", "job", "-p", "ge"], "genotype_length: 100"),
        (["--cfg", "job"], "  bnf: |\n    <dt>        ::= <if>\n"),
        (["--help"], "  bnf: |\n    <dt>        ::= <if>\n"),
        (["--version"], ge_torchrl.__version__),
        (["-sc", "install=bash"], "complete"),
    ],
)
def test_information_is_shown_without_a_run(experiment, tmp_path, capsys, arguments, shown):
    assert main(arguments) == 0
    assert shown in capsys.readouterr().out
    assert experiment.runs == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("experiment")
def test_tab_completes_keys_and_choices(capsys, monkeypatch):
    monkeypatch.setenv("COMP_LINE", "ge-torchrl ge.popu")
    assert main(["-sc", "query=bash"]) == 0
    assert capsys.readouterr().out.strip() == "ge.population_size="
    monkeypatch.setenv("COMP_LINE", "ge-torchrl env=ca")
    assert main(["-sc", "query=bash"]) == 0
    assert capsys.readouterr().out.strip() == "env=cartpole"


@pytest.mark.parametrize("arguments", [["env=foo"], ["-m", "ge.population_size=1,2"]])
def test_program_started_by_a_user_reports_a_mistake(tmp_path, arguments):
    command = [sys.executable, "-m", "ge_torchrl", *arguments]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""
    assert list(tmp_path.iterdir()) == []


def test_command_line_loads_no_torch():
    code = "import sys, ge_torchrl.__main__; sys.exit('torch' in sys.modules or 'numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=60).returncode == 0


def test_an_unknown_environment_is_told_before_anything_is_written(experiment, capsys, tmp_path):
    assert main(["env.id=MissingLink-v3"]) == 2
    assert "got MissingLink-v3" in capsys.readouterr().err
    assert main(["-m", "env.id=CartPole-v1,MissingLink-v3"]) == 2
    assert not experiment.runs
    assert not list(tmp_path.iterdir())


def test_ctrl_c_ends_a_run_well_and_the_rest_of_a_sweep(experiment):
    experiment.interrupted = {1}
    assert main(["seed=1"]) == 0
    assert main(["-m", "seed=0,1,2"]) == 130
    assert [config.seed for config, _ in experiment.runs] == [1, 0, 1]


IMPORTS = """
import sys
sys.modules["matplotlib"] = None  # As where the extra for figures is not installed.
from ge_torchrl.cli.output import prepare_output
prepare_output()
import cma, gymnasium, numba, tensordict, torch, torchrl, torchrl.collectors, torchrl.envs, torchrl.objectives
"""


def test_no_package_that_a_run_imports_prints_a_warning():
    done = subprocess.run([sys.executable, "-c", IMPORTS], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


PRINTS = """
import sys, types
room = types.ModuleType("ge_torchrl.run.experiment")
def run(config, output_dir, console):
    console.print("├─ yes: 1 ± 2 ☃")
    for line in range(1000 if "many" in sys.argv else 1):
        console.print(line)
        print(line)
    return types.SimpleNamespace(stopped_by="generations")
room.run, room.plan = run, lambda config: None
sys.modules["ge_torchrl.run.experiment"] = sys.modules["ge_torchrl.run.plan"] = room
from ge_torchrl.__main__ import main
sys.exit(main(["seed=1"]))
"""


def test_output_to_an_ascii_terminal_never_raises(tmp_path):
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(
        [sys.executable, "-c", PRINTS], cwd=tmp_path, capture_output=True, check=False, env=environment
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.decode("ascii") == "|- yes: 1 +- 2 ?\n0\n0\n"


def test_output_that_nobody_reads_any_more_ends_the_program_quietly(tmp_path):
    command = [sys.executable, "-c", PRINTS, "many"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as program:
        program.stdout.close()
        errors = program.stderr.read()
    assert (program.returncode, errors) == (141, b"")


@pytest.mark.parametrize("package", ["hydra", "yaml", "gymnasium"])
def test_ctrl_c_while_packages_are_imported_is_quiet(tmp_path, package):
    (tmp_path / f"{package}.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n")
    done = subprocess.run(
        [sys.executable, "-m", "ge_torchrl"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])},
        capture_output=True,
        check=False,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, b"", b"")


def test_information_that_nobody_reads_ends_quietly(tmp_path):
    command = [sys.executable, "-m", "ge_torchrl", "--help"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as program:
        program.stdout.close()
        errors = program.stderr.read()
    assert (program.returncode, errors) == (141, b"")


def test_jobs_run_side_by_side_with_one_thread_each(tmp_path):
    """The real program: the launcher pickles the job and runs it in processes of its own."""
    few = ["evaluation.validation_episodes=2", "evaluation.test_episodes=2"]
    small = ["ge.population_size=8", "ge.generations=2", *few]
    arguments = ["-m", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2", "refiner=none", "seed=0,1", *small]
    finished = subprocess.run(
        [sys.executable, "-m", "ge_torchrl", *arguments, "hydra.sweep.dir=sweep"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert finished.returncode == 0, finished.stderr
    folders = sorted(path.parent for path in tmp_path.glob("sweep/*/summary.json"))
    assert len(folders) == 2
    assert all("threads: 1" in (folder / "config.yaml").read_text() for folder in folders)
    failing = subprocess.run(
        [sys.executable, "-m", "ge_torchrl", *arguments, "ge.genotype_length=2", "hydra.sweep.dir=failing"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert failing.returncode == 2
    assert "no genotype of 2 codons gave a tree" in failing.stderr
