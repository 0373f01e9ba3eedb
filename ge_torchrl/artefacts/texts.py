"""Files of text: read with one line of complaint, written whole or not at all, on the disk before they count."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ge_torchrl import reading
from ge_torchrl.errors import ArtefactError


def read_text(path: Path) -> str:
    """Return a file's text; see `reading.read_text`.

    Raises:
        ArtefactError: There is no such file, it is none or too large, or it is not text in UTF-8.
    """
    return reading.read_text(path)


def write_text(path: Path, text: str) -> None:
    """Write a text.

    Raises:
        ArtefactError: The file cannot be written.
    """
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Write bytes.

    Raises:
        ArtefactError: The file cannot be written.
    """

    def write(beside: Path) -> None:
        with beside.open("wb", buffering=0) as file:
            put(file.fileno(), content)

    write_whole(path, write)


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Write beside the file and then take its place, so that nobody ever reads a half, after a loss of power either.

    Args:
        path: The file.
        write: Writes the file whose path it is given.

    Raises:
        ArtefactError: The file cannot be written.
    """
    beside = path.with_name(f".{path.name}.partial")
    with told_of(path):
        write(beside)
        _settle(beside, os.O_RDWR)
        os.replace(beside, path)  # noqa: PTH105 (one module stands between this and the disk)
        # Where a folder cannot be opened, as on Windows, the system keeps the order by itself.
        with suppress(PermissionError):
            _settle(path.parent, os.O_RDONLY)


def make_folder_of(path: Path) -> None:
    """Make the folder that a file is to lie in, where it is not there.

    Raises:
        ArtefactError: It cannot be made.
    """
    with told_of(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)


def put(descriptor: int, content: bytes) -> None:
    """Write all bytes to an open file: a disk that is nearly full takes a part, and refuses the rest."""
    rest = memoryview(content)
    while rest:
        rest = rest[os.write(descriptor, rest) :]


def settle(descriptor: int) -> None:
    """Wait until an open file is on the disk."""
    os.fsync(descriptor)


def _settle(path: Path, flags: int) -> None:
    descriptor = os.open(path, flags)
    try:
        settle(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def told_of(path: Path) -> Iterator[None]:
    """Tell in one line of what the system refuses to write.

    Raises:
        ArtefactError: The path cannot be written.
    """
    try:
        yield
    except OSError as error:
        raise ArtefactError(f"{path} cannot be written: {error.strerror}") from error
