"""A job of a sweep is run, gone on with, or left alone."""

import io

import pytest
from rich.console import Console
from runs_for_tests import assert_same_bytes, config

from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.artefacts.jobs import JOB, read_job
from ge_torchrl.artefacts.locks import is_locked
from ge_torchrl.errors import ArtefactError, EnvironmentFaultError
from ge_torchrl.run import checkpointing, experiment, running
from ge_torchrl.run.jobs import run_job

WORDS = ("env=cartpole", "seed=0")
SMALL = config(ge={"generations": 4})


class KilledError(BaseException):
    """What no code of a run answers to: as when the process is gone."""


def carried_out(folder, settings=SMALL, words=WORDS):
    output = io.StringIO()
    return run_job(settings, folder, Console(file=output, width=200), words), output.getvalue()


def test_a_job_that_is_done_is_left_alone(tmp_path):
    first, _ = carried_out(tmp_path / "job")
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "job").iterdir()}
    again, said = carried_out(tmp_path / "job")
    assert (first.generations, again, said) == (4, None, f"{tmp_path / 'job'}: done before\n")
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "job").iterdir()} == before


def test_a_job_that_was_killed_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr(checkpointing, "_TIMES", 0)
    carried_out(tmp_path / "alone")

    def killed(*_, **__):
        raise KilledError

    with monkeypatch.context() as patch:
        patch.setattr(running, "keep_episodes", killed)
        with pytest.raises(KilledError):
            carried_out(tmp_path / "job")
    assert not experiment.is_finished(tmp_path / "job")
    summary, _ = carried_out(tmp_path / "job")
    assert summary.generations == 4
    assert_same_bytes(tmp_path / "alone", tmp_path / "job")


def test_what_ended_a_job_is_written_there_and_it_can_be_done_again(tmp_path, monkeypatch):
    def failing(*_, **__):
        raise EnvironmentFaultError("it\nbroke")

    with monkeypatch.context() as patch:
        patch.setattr(experiment, "run", failing)
        with pytest.raises(EnvironmentFaultError):
            carried_out(tmp_path / "job")
    assert read_job(tmp_path / "job").error == "it broke"
    carried_out(tmp_path / "job")
    assert read_job(tmp_path / "job").error is None
    assert experiment.is_finished(tmp_path / "job")


def test_a_job_runs_from_its_beginning(tmp_path, monkeypatch):
    monkeypatch.setattr(experiment, "run", lambda _, folder, __: is_locked(folder))
    assert carried_out(tmp_path / "job")[0] is True
    assert not is_locked(tmp_path / "job")
    assert [path.name for path in (tmp_path / "job").iterdir()] == [JOB]


@pytest.mark.parametrize("other", [{"words": ("seed=1",)}, {"settings": config(ge={"generations": 5})}])
def test_a_folder_with_another_run_stays_as_it_is(tmp_path, other):
    carried_out(tmp_path / "job")
    before = (tmp_path / "job" / JOB).read_text()
    with pytest.raises(ArtefactError, match="without a run"):
        carried_out(tmp_path / "job", **other)
    assert (tmp_path / "job" / JOB).read_text() == before
    assert RunFolder(tmp_path / "job").read_summary().generations == 4


def test_threads_make_no_other_job(tmp_path):
    carried_out(tmp_path / "job")
    assert carried_out(tmp_path / "job", config(ge={"generations": 4}, evaluation={"threads": 1}))[0] is None
