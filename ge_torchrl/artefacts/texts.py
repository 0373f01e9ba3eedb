"""Files of text: read with one line of complaint, written whole or not at all."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
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
    write_whole(path, lambda beside: beside.write_text(text, encoding="utf-8"))


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Write beside the file and then take its place, so that nobody ever reads a half.

    Args:
        path: The file.
        write: Writes the file whose path it is given.

    Raises:
        ArtefactError: The file cannot be written.
    """
    beside = path.with_name(f".{path.name}.partial")
    with told_of(path):
        write(beside)
        beside.replace(path)


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
