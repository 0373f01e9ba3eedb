"""A sweep by an engine: a job that fails or dies costs no other, and what comes out is what one process finds."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from types import ModuleType

import pytest
from pages_for_tests import ROOT
from runs_for_tests import assert_same_bytes
from sweep_walk_for_tests import STARTED_BY, STATUS

from ge_torchrl.__main__ import main
from ge_torchrl.cli import engines
from ge_torchrl.cli.engines import check_engine
from ge_torchrl.errors import ConfigError

SUPPORT = ROOT / "tests" / "support"
SWEEP = [
    "env.id=sweep_walk_for_tests:SweepWalk-v0", "env.kwargs.how=ends,raises,dies", "seed=1", "refiner=none",
    "archive=none", "polish=none", "ge.generations=2", "ge.population_size=8", "evaluation.episodes=2",
    "evaluation.validation_episodes=2", "evaluation.test_episodes=2", "evaluation.steps_per_second=10000",
]  # fmt: skip


@pytest.fixture
def place(tmp_path, monkeypatch):
    """The folder of two sweeps, whose processes find the walk."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(STARTED_BY, str(os.getpid()))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(ROOT), str(SUPPORT))))
    return tmp_path


def check_sweep(launcher, place, capfd):
    """Check a sweep of three jobs of which one raises and one dies; `place` holds nothing before."""
    assert main(["-m", *launcher, *SWEEP, "hydra.sweep.dir=there"]) == 1
    printed = capfd.readouterr()
    jobs = sorted((place / "there").glob("[0-9]_*"))
    assert [path.name for path in jobs if (path / "summary.json").exists()] == [jobs[0].name]
    assert f"done    there/{jobs[0].name}\n" in printed.out
    assert f"failed  there/{jobs[1].name}: " in printed.err
    assert f"failed  there/{jobs[2].name}: its process ended too early" in printed.err
    assert f"  running  {jobs[0].name}" in STATUS.read_text().splitlines()
    assert main(["status", "there"]) == 0
    told = capfd.readouterr().out
    assert told.startswith("there: 3 jobs, 1 done, 2 failed\n")
    assert "the motor is on fire" in told
    # Another launcher does what is missing, and finds what one process finds.
    assert main(["-m", *SWEEP, "hydra.sweep.dir=there"]) == 0
    assert "".join(capfd.readouterr().out.split()).count("donebefore") == 1
    assert main(["-m", *SWEEP, "hydra.sweep.dir=alone"]) == 0
    for path in jobs:
        assert_same_bytes(path, place / "alone" / path.name)
    # And where nothing is missing, no process is started.
    capfd.readouterr()
    assert main(["-m", *launcher, *SWEEP, "hydra.sweep.dir=alone"]) == 0
    assert capfd.readouterr().out.startswith("3 of 3 jobs done before\n\n")


def test_a_sweep_by_submitit(place, monkeypatch, capfd):
    submitit = pytest.importorskip("submitit")
    # How long it waits for the result of a process that died, lest its disk be slow.
    monkeypatch.setattr(submitit.Job, "_results_timeout_s", 0)
    check_sweep(["hydra/launcher=slurm", "hydra.launcher.cluster=local"], place, capfd)


def test_a_job_whose_time_is_up_is_queued_again_as_it_was():
    pytest.importorskip("submitit")
    work, task = engines._Work(), engines.Task(None, Path("there"), ("seed=1",))
    again = work.checkpoint(task)
    assert (again.function, again.args) == (work, (task,))


@pytest.fixture
def cluster(place, monkeypatch):
    """The address of a Ray cluster with two workers, of which nothing is left at the end."""
    pytest.importorskip("ray")
    # A busy machine is given more time; nothing is counted for Ray's makers; no secret is left at home.
    for name in ("raylet_start_wait_time_s", "worker_register_timeout_seconds"):
        monkeypatch.setenv(f"RAY_{name}", "200")
    monkeypatch.setenv("RAY_agent_register_timeout_ms", "200000")
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")
    # The name of a socket has at most 107 letters.
    with tempfile.TemporaryDirectory(prefix="ray", ignore_cleanup_errors=True) as short:
        monkeypatch.setenv("RAY_TMPDIR", short)
        (Path(short) / "ray").mkdir()
        helper = subprocess.Popen(
            [sys.executable, str(SUPPORT / "ray_cluster_for_tests.py"), f"{short}/ray"],
            cwd=place, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        with helper:
            try:
                yield helper.stdout.readline().strip()
            finally:
                helper.stdin.close()
                assert helper.wait() == 0
        assert [line for line in processes() if short in line] == []


def processes():
    """Return the command lines of all processes."""
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            yield path.read_text(errors="replace")
        except OSError:
            continue


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # Of Ray's own code.
def test_a_sweep_by_ray(cluster, place, capfd):
    check_sweep(["hydra/launcher=ray", f"hydra.launcher.address={cluster}"], place, capfd)


@pytest.mark.usefixtures("experiment")
@pytest.mark.parametrize(("engine", "package"), [("slurm", "submitit"), ("ray", "ray")])
def test_an_engine_that_is_not_installed_is_told_with_what_to_install(
    engine, package, monkeypatch, capsys, tmp_path
):
    monkeypatch.setitem(sys.modules, package, None)
    sweep = tmp_path / "sweep"
    assert main(["-m", f"hydra/launcher={engine}", "seed=1,2", f"hydra.sweep.dir={sweep}"]) == 2
    assert not sweep.exists()
    expected = f'needs {package}; expected it installed: pip install -c constraints.txt -e ".[{engine}]"\n'
    assert capsys.readouterr().err == f"ge-torchrl: hydra/launcher={engine} {expected}"


def test_a_folder_by_the_name_of_an_engine_is_no_engine(monkeypatch):
    folder = ModuleType("ray")
    folder.__file__ = None  # As of a folder without any module.
    monkeypatch.setitem(sys.modules, "ray", folder)
    with pytest.raises(ConfigError, match="needs ray; expected it installed"):
        check_engine("ray")


@pytest.mark.usefixtures("experiment")
@pytest.mark.parametrize(
    ("words", "told"),
    [
        (
            "hydra.launcher.cpus_per_task=0",
            "hydra.launcher.cpus_per_task must be a whole number of at least 1",
        ),
        ("hydra.launcher.mem_gb=much", "hydra/launcher=slurm takes no jobs"),
        ("hydra.launcher.cluster=sluurm", "hydra/launcher=slurm takes no jobs"),
        ("hydra.launcher.partiton=night", "Key 'partiton' is not in struct"),
        ("hydra/sweeper=basic", "hydra.launcher.cluster=local does without Slurm"),
    ],
)
def test_what_an_engine_does_not_take_is_one_line(words, told, monkeypatch, capsys):
    pytest.importorskip("submitit")
    monkeypatch.setenv("PATH", "")  # No srun.
    assert main(["-m", "hydra/launcher=slurm", words, "seed=1,2"]) == 2
    printed = capsys.readouterr().err
    assert told in printed
    assert printed.count("\n") == 1
