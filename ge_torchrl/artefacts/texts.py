"""Files of text: read with one line of complaint, written whole or not at all."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ge_torchrl.errors import ArtefactError


def read_text(path: Path) -> str:
    """Return a file's text.

    Raises:
        ArtefactError: There is no such file, or it is not text in UTF-8.
    """
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise ArtefactError(f"{path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ArtefactError(f"{path} is not text in UTF-8: {error}") from error


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

    def write_and_replace(_: Path) -> None:
        write(beside)
        beside.replace(path)

    try_to_write(path, write_and_replace)


def try_to_write(path: Path, write: Callable[[Path], object]) -> None:
    """Do something to a path.

    Raises:
        ArtefactError: It cannot be done.
    """
    try:
        write(path)
    except OSError as error:
        raise ArtefactError(f"{path} cannot be written: {error.strerror}") from error
