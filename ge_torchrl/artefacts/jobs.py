"""What a sweep leaves beside its runs: which jobs it has, and in each run's folder which job it is and what failed.

| file | content |
|---|---|
| `sweep.json` | in the sweep's folder: the words of each job, and what was typed |
| `job.json` | in a run's folder: the words of its job, a digest of its settings, and the error that ended it |
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ge_torchrl.artefacts.lines import checked_values, with_checksum
from ge_torchrl.artefacts.texts import told_of, write_text
from ge_torchrl.errors import ArtefactError
from ge_torchrl.printing import message_of, printable
from ge_torchrl.reading import is_there, read_text

SWEEP, JOB = "sweep.json", "job.json"

Words = tuple[str, ...]
"""What is typed, such as `("env=cartpole", "seed=3")`."""


@dataclass(frozen=True)
class Sweep:
    """The jobs of a sweep.

    Attributes:
        jobs: The words of each job.
        command: What was typed last to run them.
    """

    jobs: tuple[Words, ...]
    command: Words


@dataclass(frozen=True)
class Job:
    """A job of a sweep.

    Attributes:
        words: Its words.
        settings: A digest of its configuration: another one is another job.
        error: What ended it, in a line; None where nothing did.
    """

    words: Words
    settings: str
    error: str | None = None


def write_sweep(folder: Path, sweep: Sweep) -> None:
    """Write the jobs of a sweep, behind those that an earlier one left in the same folder.

    Raises:
        ArtefactError: The folder cannot be written.
    """
    with told_of(folder):
        folder.mkdir(parents=True, exist_ok=True)
    earlier = read_sweep(folder)
    jobs = dict.fromkeys((*(earlier.jobs if earlier else ()), *sweep.jobs))
    _write(folder / SWEEP, {"jobs": list(jobs), "command": sweep.command})


def read_sweep(folder: Path) -> Sweep | None:
    """Return the jobs of the sweep in a folder; None where none was written.

    Raises:
        ArtefactError: The file is not in its format.
    """
    path = folder / SWEEP
    if not is_there(path):
        return None
    values = _read(path)
    jobs = values.get("jobs")
    if not isinstance(jobs, list):
        raise ArtefactError(f"{path}: jobs must be an array of arrays of texts")
    return Sweep(
        tuple(_words(path, "a job", job) for job in jobs), _words(path, "command", values.get("command"))
    )


def find_sweeps(folder: Path) -> Iterator[tuple[Path, Sweep]]:
    """Yield the folders of the sweeps in a folder and below it, in the order of their paths.

    Raises:
        ArtefactError: A file is not in its format.
    """
    for path in sorted(folder.rglob(SWEEP)):
        sweep = read_sweep(path.parent)
        if sweep is not None:
            yield path.parent, sweep


def write_job(folder: Path, job: Job) -> None:
    """Write which job a run is.

    Raises:
        ArtefactError: The folder cannot be written.
    """
    with told_of(folder):
        folder.mkdir(parents=True, exist_ok=True)
    _write(folder / JOB, asdict(job))


def read_job(folder: Path) -> Job | None:
    """Return which job the run in a folder is; None where that is not told.

    Raises:
        ArtefactError: The file is not in its format.
    """
    path = folder / JOB
    if not is_there(path):
        return None
    values = _read(path)
    settings, error = values.get("settings"), values.get("error")
    if not (isinstance(settings, str) and isinstance(error, str | None)):
        raise ArtefactError(f"{path}: settings must be a text, and error a text or null")
    words = _words(path, "words", values.get("words"))
    return Job(words, settings, None if error is None else message_of(error))


def find_jobs(folder: Path) -> Iterator[tuple[Path, Job]]:
    """Yield the folders of the jobs in a folder and below it, in the order of their paths.

    Raises:
        ArtefactError: A file is not in its format.
    """
    for path in sorted(folder.rglob(JOB)):
        job = read_job(path.parent)
        if job is not None:
            yield path.parent, job


def _write(path: Path, values: Mapping[str, Any]) -> None:
    write_text(path, with_checksum(values, indent=2) + "\n")


def _read(path: Path) -> dict[str, Any]:
    return checked_values(read_text(path), str(path))


def _words(path: Path, name: str, values: object) -> Words:
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        raise ArtefactError(f"{path}: {name} must be an array of texts")
    return tuple(map(printable, values))
