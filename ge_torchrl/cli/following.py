"""`status`: which jobs of a sweep are done, and the command that does the others."""

import shlex
from collections import Counter
from pathlib import Path
from typing import NamedTuple

from ge_torchrl.cli.parser import Parser
from ge_torchrl.cli.statuses import OK
from ge_torchrl.errors import ArtefactError

DONE, RUNNING, FAILED, STOPPED, MISSING = "done", "running", "failed", "stopped", "missing"
_PROGRAM = "python -m ge_torchrl"


class _State(NamedTuple):
    state: str
    words: tuple[str, ...]
    folder: Path | None = None
    error: str = ""


def status(arguments: list[str]) -> int:
    """Tell how far sweeps are, as `status --help` tells; return the exit status."""
    parser = Parser(
        prog="ge-torchrl status",
        description="Tell which jobs of a sweep are done, running, failed, stopped or missing, and the command that "
        "runs those that are not done.",
    )
    parser.add_argument(
        "folder", metavar="DIR", type=Path, help="a sweep's folder, or any above several of them"
    )
    options = parser.parse_args(arguments)

    from ge_torchrl.artefacts.jobs import SWEEP, find_sweeps

    sweeps = list(find_sweeps(options.folder))
    if not sweeps:
        raise ArtefactError(
            f"expected the folder of a sweep, which -m makes and which holds {SWEEP}; there is none in {options.folder}"
        )
    for number, (folder, sweep) in enumerate(sweeps):
        if number > 0:
            print()
        states = _states(folder, sweep.jobs)
        _tell(folder, states)
        if any(one.state in (FAILED, STOPPED, MISSING) for one in states):
            print(f"to do what is not done:\n  {_PROGRAM} {shlex.join(_in(folder, sweep.command))}")
    return OK


def _states(folder: Path, jobs: tuple[tuple[str, ...], ...]) -> list[_State]:
    from ge_torchrl.artefacts.jobs import find_jobs
    from ge_torchrl.artefacts.locks import is_locked
    from ge_torchrl.run.experiment import is_finished

    states = []
    for path, job in find_jobs(folder):
        if is_locked(path):
            state = RUNNING
        elif is_finished(path):
            state = DONE
        else:
            state = FAILED if job.error else STOPPED
        states.append(_State(state, job.words, path, job.error or ""))
    begun = {one.words for one in states}
    return states + [_State(MISSING, words) for words in jobs if words not in begun]


def _tell(folder: Path, states: list[_State]) -> None:
    counts = Counter(one.state for one in states)
    parts = [
        f"{counts[state]} {state}" for state in (DONE, RUNNING, FAILED, STOPPED, MISSING) if counts[state]
    ]
    print(f"{folder}: {len(states)} job{'s' * (len(states) != 1)}, {', '.join(parts)}")
    for one in states:
        if one.state != DONE:
            job = one.folder.relative_to(folder) if one.folder else " ".join(one.words)
            print(f"  {one.state:<8} {job}" + f": {one.error}" * bool(one.error))


def _in(folder: Path, command: tuple[str, ...]) -> list[str]:
    """Return a command that leaves its runs in a folder."""
    others = [word for word in command if not word.startswith("hydra.sweep.dir=")]
    return [*others, f"hydra.sweep.dir={folder}"]
