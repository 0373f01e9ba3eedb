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
    from ge_torchrl.run.experiment import is_finished, resume, run

    if words is None:
        return run(config, folder, console)
    job, earlier = Job(words, _digest(config)), read_job(folder)
    is_the_same = earlier is not None and replace(earlier, error=None) == job
    if is_the_same and is_finished(folder):
        console.print(f"{folder}: done before")
        return None
    if not is_the_same and any((folder / name).exists() for name in (HISTORY, SUMMARY)):
        return run(config, folder, console)  # It refuses a folder with another run.
    write_job(folder, job)
    try:
        if is_the_same and (folder / CONFIG).exists():
            return resume(folder, console)
        return run(config, folder, console)
    except Exception as error:
        with suppress(ArtefactError):
            write_job(folder, replace(job, error=" ".join(str(error).split()) or type(error).__name__))
        raise


def _digest(config: Config) -> str:
    """Return a digest of all settings that decide what a run finds: not of how many threads look for it."""
    values = config.as_mapping()
    values["evaluation"].pop("threads", None)
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]
