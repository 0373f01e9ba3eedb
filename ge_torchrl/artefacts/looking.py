"""What is said of a path that should be the folder of a run and is none."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

from ge_torchrl.artefacts.folder import CONFIG
from ge_torchrl.artefacts.jobs import SWEEP
from ge_torchrl.errors import ArtefactError
from ge_torchrl.reading import is_folder, is_there, name_of

# Folders below one are looked through as long as a person waits.
_MOST_LOOKED_AT = 10_000


def check_run(path: Path, *needed: str) -> None:
    """Refuse a path that is no folder of a run, or of one that has not come so far.

    Args:
        path: The path.
        needed: Files, one of which has to be there.

    Raises:
        ArtefactError: It is none; the message names a run below it where there is one.
    """
    if any(is_there(path / name) for name in needed):
        return
    named = name_of(path)
    if not is_folder(path):
        raise ArtefactError(
            f"expected the folder of a run; {named} is {'a file' if is_there(path) else 'not there'}"
        )
    if is_there(path / CONFIG):
        raise ArtefactError(
            f"the run in {named} must have {needed[0]}; it has none yet: it goes on, or was broken off, and then "
            f"ge-torchrl resume {named} goes on with it"
        )
    first = next(_below(path, needed), None)
    told = "; it holds no run" if first is None else f"; the first one below it is {name_of(first)}"
    if is_there(path / SWEEP):
        told += f"; ge-torchrl status {named} tells which runs of the sweep are not done, and what to type"
    raise ArtefactError(f"{named} must be the folder of one run, which holds {needed[0]}{told}")


def _below(folder: Path, needed: tuple[str, ...]) -> Iterator[Path]:
    """Yield the folders of runs below one."""
    for path in itertools.islice(folder.rglob("*"), _MOST_LOOKED_AT):
        if path.name in needed:
            yield path.parent
