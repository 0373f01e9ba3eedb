"""Jobs of a sweep that left no finished run: which, and what is known of them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from ge_torchrl.artefacts.folder import HISTORY, SUMMARY, TRACEBACK, RunFolder
from ge_torchrl.errors import ArtefactError
from ge_torchrl.report.unfinished import FAILED, RUNNING, state_of

_NOTHING = "it failed before it began, or has not begun"
_NUMBERED = re.compile(r"(\d+)(?:_|$)")


class UnfinishedJob(NamedTuple):
    """A job without a summary.

    Attributes:
        name: Its folder, below the one that was asked for; or "job 3" where it has none.
        state: "running", "failed", "stopped" or "missing", as `status` has it.
        told: What is known of it, in one line.
        path: Its folder; None where it left nothing to look at.
    """

    name: str
    state: str
    told: str
    path: Path | None = None


def unfinished_jobs(folder: Path) -> list[UnfinishedJob]:
    """Return the jobs in a folder and below it that broke off, go on, or left no folder, by name."""
    begun = {path.parent for name in (HISTORY, TRACEBACK) for path in folder.rglob(name)}
    jobs = [_job(path, folder) for path in sorted(begun) if not (path / SUMMARY).exists()]
    return [*jobs, *_missing(folder)]


def _job(path: Path, folder: Path) -> UnfinishedJob:
    name = path.relative_to(folder).as_posix() if path != folder else path.name
    state, fault = state_of(path)
    if state == FAILED:
        return UnfinishedJob(name, state, fault, path)
    try:
        history = RunFolder(path).read_history()
    except ArtefactError:
        history = []
    if not history:
        return UnfinishedJob(name, state, "no generation is written yet", path)
    last = history[-1]
    best = "" if last.best is None else f", best fitness {last.best:.2f}"
    after = "" if state == RUNNING else "; resume goes on with it"
    told = f"{last.generation + 1} generations in {last.elapsed_seconds:.0f} s{best}{after}"
    return UnfinishedJob(name, state, told, path)


def _missing(folder: Path) -> Iterator[UnfinishedJob]:
    """Yield the jobs of a sweep that left nothing, or whose numbers are left out among its folders."""
    folders = [path for path in sorted(folder.iterdir()) if path.is_dir()] if folder.is_dir() else []
    numbered = {int(found[1]): path for path in folders if (found := _NUMBERED.match(path.name))}
    if len(numbered) < 2:
        return
    for number in range(max(numbered) + 1):
        path = numbered.get(number)
        if path is None:
            yield UnfinishedJob(f"job {number}", "missing", f"left no folder: {_NOTHING}")
        elif not any(path.rglob(HISTORY)) and not any(path.rglob(TRACEBACK)):
            state, fault = state_of(path)
            if state == FAILED:
                yield UnfinishedJob(path.name, state, fault)
            else:
                yield UnfinishedJob(path.name, "missing", f"left nothing in its folder: {_NOTHING}")
