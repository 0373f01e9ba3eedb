"""What a finished run left is what is read: its summary lists the SHA-256 of every other file.

A folder of an earlier version lists none, and is read as it is.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path

from ge_torchrl.errors import ArtefactError
from ge_torchrl.reading import is_there, name_of, read_bytes

SUMS = "sha256"
"""The key of the summary's file that holds them, by the paths of the files below the run's folder."""


def sums_of(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """Return the SHA-256 of files by their paths, as hexadecimal digits.

    Args:
        folder: Where they lie.
        names: Of files, and of folders whose files are meant; what is not there is left out.

    Raises:
        ArtefactError: One cannot be read.
    """
    there = [folder / name for name in names]
    files = [path for name in there for path in (name.iterdir() if name.is_dir() else [name])]
    return {path.relative_to(folder).as_posix(): _sum(path) for path in sorted(files) if path.is_file()}


def check_sum(folder: Path, name: str, sums: Mapping[str, str], *, remedy: str) -> None:
    """Refuse a file that is not the one that was written; one that is not listed is taken as it is.

    Args:
        folder: Where it lies.
        name: Its path below that.
        sums: What is listed.
        remedy: What to do where somebody changed it on purpose.

    Raises:
        ArtefactError: It is another file, or gone.
    """
    path = folder / name
    if name not in sums:
        return
    if not is_there(path):
        raise ArtefactError(f"{name_of(path)} is gone, which its run wrote; bring it back from a copy")
    if hashlib.sha256(read_bytes(path)).hexdigest() != sums[name]:
        raise ArtefactError(
            f"{name_of(path)} must be what its run wrote, because numbers are told of it; its SHA-256 is another "
            f"one, so it is damaged or was changed; bring it back from a copy, or, where the change is yours, {remedy}"
        )


def _sum(path: Path) -> str:
    # The history of a long run may be longer than what is read whole.
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise ArtefactError(f"{name_of(path)} cannot be read: {error.strerror}") from error
