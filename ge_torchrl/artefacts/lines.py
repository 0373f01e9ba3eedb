"""Records as lines of JSON, in and out, each with a checksum as its last key.

A line is appended whole; what a kill or a full disk leaves of the last one has no line break yet, and is no line.
"""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Mapping
from dataclasses import MISSING, asdict, fields
from pathlib import Path
from types import TracebackType
from typing import IO, Any, NamedTuple, Self, TypeVar

from ge_torchrl.artefacts.checking import check_values
from ge_torchrl.artefacts.records import ArchiveRecord, GenerationRecord, RefinementRecord, Summary
from ge_torchrl.artefacts.sums import SUMS
from ge_torchrl.artefacts.texts import put, read_text, settle, told_of
from ge_torchrl.errors import ArtefactError
from ge_torchrl.reading import json_of, read_bytes

_Record = TypeVar("_Record", GenerationRecord, RefinementRecord, ArchiveRecord, Summary)

CHECKSUM = "crc32"
"""The last key of each record: of the JSON of all other keys, as Python writes it."""


class Mark(NamedTuple):
    """How far a file of lines was written.

    Attributes:
        size: In bytes.
        crc32: Of these bytes.
    """

    size: int = 0
    crc32: int = 0

    def after(self, content: bytes) -> Mark:
        """Return the mark after some more bytes."""
        return Mark(self.size + len(content), zlib.crc32(content, self.crc32))

    def holds(self, path: Path) -> bool:
        """Tell whether a file begins with these bytes."""
        try:
            return Mark().after(read_bytes(path)[: self.size]) == self
        except ArtefactError:
            return self.size == 0


class RecordWriter:
    """Writes records line by line, so that an interrupted run keeps what it had.

    Args:
        path: The file; entering the context makes it.
        mark: What of it stays, mostly nothing.

    Attributes:
        mark: How far it is written.
    """

    def __init__(self, path: Path, mark: Mark = Mark()) -> None:  # noqa: B008 (a constant)
        self._path = path
        self._file: IO[bytes] | None = None
        self.mark = mark

    def __enter__(self) -> Self:
        with told_of(self._path):
            self._file = self._path.open("ab", buffering=0)
            self._file.truncate(self.mark.size)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._file is not None:
            self._file.close()

    def write(self, record: GenerationRecord | RefinementRecord) -> None:
        """Append one record; numbers that are not finite become null.

        Raises:
            ArtefactError: The file cannot be written.
        """
        content = to_json(record).encode()
        with told_of(self._path):
            put(self._opened.fileno(), content)
        self.mark = self.mark.after(content)

    def settle(self) -> None:
        """Wait until all of it is on the disk.

        Raises:
            ArtefactError: The disk refuses it.
        """
        with told_of(self._path):
            settle(self._opened.fileno())

    @property
    def _opened(self) -> IO[bytes]:
        if self._file is None:
            raise ValueError("records are written inside a with statement")
        return self._file


def to_json(record: GenerationRecord | RefinementRecord | ArchiveRecord) -> str:
    """Return the record as JSON with a final line break; numbers that are not finite, which JSON lacks, become null."""
    return with_checksum(_plain(record)) + "\n"


def summary_text(summary: Summary, sums: Mapping[str, str]) -> str:
    """Return the text of a summary's file, which lists the other files of its run; see `sums`."""
    return with_checksum(_plain(summary) | {SUMS: dict(sums)}, indent=2) + "\n"


def _plain(record: GenerationRecord | RefinementRecord | ArchiveRecord | Summary) -> dict[str, Any]:
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in asdict(record).items()
    }


def with_checksum(values: Mapping[str, Any], indent: int | None = None) -> str:
    """Return plain values as a JSON object whose last key is the checksum of the others."""
    return json.dumps({**values, CHECKSUM: _checksum(values)}, indent=indent, allow_nan=False)


def _checksum(values: Mapping[str, Any]) -> str:
    return f"{zlib.crc32(json.dumps(values).encode()):08x}"


def checked_values(text: str, source: str) -> dict[str, Any]:
    """Return what a JSON object holds beside its checksum; an earlier version wrote none.

    Args:
        text: Of the object.
        source: The text's name in messages.

    Raises:
        ArtefactError: It is none, or the checksum is that of another one.
    """
    try:
        values: Any = json_of(text)
    except ValueError as error:
        raise ArtefactError(f"{source} is not JSON: {error}") from error
    if not isinstance(values, dict):
        raise ArtefactError(f"{source} must be a JSON object")
    checksum = values.pop(CHECKSUM, None)
    if checksum != _checksum(values) and (checksum is not None or SUMS in values):
        yours = (
            f"; where the change is yours, remove its keys {SUMS} and {CHECKSUM}" if SUMS in values else ""
        )
        raise ArtefactError(
            f"{source} is damaged: its {CHECKSUM} is {checksum!r}, but its other keys make {_checksum(values)!r}{yours}"
        )
    return values


def read_sums(path: Path) -> Mapping[str, str]:
    """Return what a summary's file lists of the other files of its run; an earlier version listed none.

    Raises:
        ArtefactError: It cannot be read, or is damaged.
    """
    sums = checked_values(read_text(path), str(path)).get(SUMS, {})
    if not isinstance(sums, dict) or not all(isinstance(value, str) for value in sums.values()):
        raise ArtefactError(f"{path}: {SUMS} must be an object of texts")
    return sums


def read_records(kind: type[_Record], path: Path) -> list[_Record]:
    """Read a file with a record a line; a last line that was not written to its end is left out.

    Raises:
        ArtefactError: There is no such file, or a line is not a record.
    """
    *lines, last = read_text(path).split("\n")
    if last and not _is_torn(kind, last):
        lines.append(last)
    return [_record(kind, line, f"{path}:{n}") for n, line in enumerate(lines, 1)]


def _is_torn(kind: type[_Record], line: str) -> bool:
    """Tell whether a line without a line break is the beginning of a record that was to be appended."""
    begins = f'{{"{fields(kind)[0].name}": '
    appended = kind in (GenerationRecord, RefinementRecord)
    return appended and not line.endswith("}") and (line.startswith(begins) or begins.startswith(line))


def read_record(kind: type[_Record], path: Path) -> _Record:
    """Read a file that is one record.

    Raises:
        ArtefactError: There is no such file, or it is not a record.
    """
    return _record(kind, read_text(path), str(path))


def _record(kind: type[_Record], text: str, source: str) -> _Record:
    values = checked_values(text, source)
    given = [field for field in fields(kind) if field.init]
    # A field with a default may be younger than the file, as the checksum may be.
    required = {field.name for field in given if field.default is MISSING}
    if missing := sorted(required - values.keys()):
        raise ArtefactError(
            f"{source} must be an object with every key of a {kind.__name__}; missing: {missing}"
        )
    # JSON knows lists alone, records tuples alone.
    known: dict[str, Any] = {
        field.name: tuple(value) if isinstance(value := values[field.name], list) else value
        for field in given
        if field.name in values
    }
    check_values(kind, known, source)
    return kind(**known)
