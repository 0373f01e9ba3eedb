"""A job of a sweep: it is run, gone on with, or left alone where it has come to its end."""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from ge_torchrl.artefacts.folder import CONFIG, HISTORY, SUMMARY
from ge_torchrl.artefacts.jobs import Job, Words, read_job, write_job
from ge_torchrl.artefacts.locks import JOB_LOCK, Lock
from ge_torchrl.artefacts.records import Summary
from ge_torchrl.config import Config
from ge_torchrl.errors import ArtefactError


def run_job(config: Config, folder: Path, console: Console, words: Words | None) -> Summary | None:
    """Run an experiment; of a job of a sweep do what is left.

    Args:
        config: Everything its run depends on.
        folder: The run's folder. Where it holds this very job already, only what is missing of it is done.
        console: Where progress goes.
        words: What was typed for this job; None for a run by itself.

    Returns:
        The summary; None where the job has come to its end before.

    Raises:
        UserError: It cannot be run; the folder holds another run, for example.
        RunFaultError: Something else failed; the best tree so far is in the folder.
    """
    from ge_torchrl.run.experiment import resume, run

    if words is None:
        return run(config, folder, console)
    if is_done(config, folder, words):
        console.print(f"{folder}: done before")
        return None
    job = Job(words, _digest(config))
    is_the_same = _is_there(job, folder)
    if not is_the_same and any((folder / name).exists() for name in (HISTORY, SUMMARY)):
        return run(config, folder, console)  # It refuses a folder with another run.
    write_job(folder, job)
    lock = Lock(folder, JOB_LOCK)
    try:
        if is_the_same and (folder / CONFIG).exists():
            return resume(folder, console)
        return run(config, folder, console)
    except Exception as error:
        record_failure(config, folder, words, str(error) or type(error).__name__)
        raise
    finally:
        lock.release()


def is_done(config: Config, folder: Path, words: Words) -> bool:
    """Tell whether this very job has come to its end before.

    Args:
        config: Everything its run depends on.
        folder: The run's folder.
        words: What was typed for this job.
    """
    from ge_torchrl.run.experiment import is_finished

    return _is_there(Job(words, _digest(config)), folder) and is_finished(folder)


def record_failure(config: Config, folder: Path, words: Words, error: str) -> None:
    """Write into the folder of a job what ended it; where that cannot be written, nothing is.

    Args:
        config: Everything its run depends on.
        folder: The run's folder.
        words: What was typed for this job.
        error: What ended it; it becomes one line.
    """
    with suppress(ArtefactError):
        write_job(folder, Job(words, _digest(config), " ".join(error.split())))


def _is_there(job: Job, folder: Path) -> bool:
    earlier = read_job(folder)
    return earlier is not None and replace(earlier, error=None) == job


def _digest(config: Config) -> str:
    """Return a digest of all settings that decide what a run finds: not of how many threads look for it."""
    values = config.as_mapping()
    values["evaluation"].pop("threads", None)
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]
