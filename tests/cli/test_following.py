"""`status` tells which jobs of a sweep are done, and its command does the others."""

import json
import shlex

import pytest
from sweeps_for_tests import write_run

from ge_torchrl.__main__ import main
from ge_torchrl.artefacts.jobs import JOB, Job, read_sweep, write_job
from ge_torchrl.artefacts.locks import Lock

COMMAND = ["-m", "env=cartpole", "seed=range(0,5)", "ge.generations=3"]


def forget_jobs(folder):
    for path in folder.rglob(JOB):
        path.unlink()


def a_sweep(tmp_path):
    """A sweep of five jobs of which one is done, one runs, one failed, one was killed and one never began."""
    assert main([*COMMAND, "hydra.sweep.dir=there"]) == 0
    folder = tmp_path / "there"
    forget_jobs(folder)
    for number, words in enumerate(read_sweep(folder).jobs[:4]):
        write_job(folder / f"{number}_job", Job(words, "abc", "it broke" if number == 2 else None))
    write_run(folder / "0_job", seed=0)
    return folder


@pytest.mark.usefixtures("experiment")
def test_every_state_is_told_with_the_command_that_does_the_rest(tmp_path, capsys):
    folder = a_sweep(tmp_path)
    lock = Lock(folder / "1_job")
    assert main(["status", "there"]) == 0
    lock.release()
    assert capsys.readouterr().out.splitlines() == [
        "there: 5 jobs, 1 done, 1 running, 1 failed, 1 stopped, 1 missing",
        "  running  1_job",
        "  failed   2_job: it broke",
        "  stopped  3_job",
        "  missing  env=cartpole seed=4 ge.generations=3",
        "to do what is not done:",
        f"  python -m ge_torchrl {shlex.join(COMMAND)} hydra.sweep.dir=there",
    ]


@pytest.mark.usefixtures("experiment")
def test_a_sweep_that_is_done_needs_no_command(tmp_path, capsys):
    assert main(["-m", "seed=7", "hydra.sweep.dir=there"]) == 0
    forget_jobs(tmp_path / "there")
    write_job(tmp_path / "there" / "0_job", Job(("seed=7",), "abc"))
    write_run(tmp_path / "there" / "0_job", seed=7)
    assert main(["status", "."]) == 0
    assert capsys.readouterr().out == "there: 1 job, 1 done\n"


def test_a_folder_without_a_sweep_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["status", "nowhere"]) == 2
    assert "expected the folder of a sweep" in capsys.readouterr().err


@pytest.mark.usefixtures("experiment")
def test_the_words_of_a_job_are_those_that_hydra_gives_it(tmp_path):
    assert (
        main(
            [
                "-m",
                "seed=3,4",
                "refiner=none,ppo",
                "env.kwargs.how=a:b",
                "++ge.generations=2",
                "hydra.sweep.dir=there",
            ]
        )
        == 0
    )
    written = {tuple(json.loads(path.read_text())["words"]) for path in (tmp_path / "there").rglob(JOB)}
    assert written == set(read_sweep(tmp_path / "there").jobs)
    assert len(written) == 4
