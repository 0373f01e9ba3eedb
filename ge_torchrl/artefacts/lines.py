"""Records as lines of JSON, in and out."""

from __future__ import annotations

import json
import math
from dataclasses import MISSING, asdict, fields
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self, TypeVar

from ge_torchrl.artefacts.checking import check_values
from ge_torchrl.artefacts.records import ArchiveRecord, GenerationRecord, RefinementRecord, Summary
from ge_torchrl.artefacts.texts import read_text, told_of
from ge_torchrl.errors import ArtefactError
from ge_torchrl.reading import json_of

_Record = TypeVar("_Record", GenerationRecord, RefinementRecord, ArchiveRecord, Summary)


class RecordWriter:
    """Writes records line by line, so that an interrupted run keeps what it had.

    Args:
        path: The file; entering the context empties it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: IO[str] | None = None

    def __enter__(self) -> Self:
        with told_of(self._path):
            self._file = self._path.open("w", encoding="utf-8", buffering=1)
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
        if self._file is None:
            raise ValueError("records are written inside a with statement")
        with told_of(self._path):
            self._file.write(to_json(record))


def to_json(
    record: GenerationRecord | RefinementRecord | ArchiveRecord | Summary, indent: int | None = None
) -> str:
    """Return a record as JSON with a final line break; numbers that are not finite, which JSON lacks, become null."""
    values = {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in asdict(record).items()
    }
    return json.dumps(values, indent=indent, allow_nan=False) + "\n"


def read_records(kind: type[_Record], path: Path) -> list[_Record]:
    """Read a file with a record a line.

    Raises:
        ArtefactError: There is no such file, or a line is not a record.
    """
    return [_record(kind, line, f"{path}:{n}") for n, line in enumerate(read_text(path).splitlines(), 1)]


def read_record(kind: type[_Record], path: Path) -> _Record:
    """Read a file that is one record.

    Raises:
        ArtefactError: There is no such file, or it is not a record.
    """
    return _record(kind, read_text(path), str(path))


def _record(kind: type[_Record], text: str, source: str) -> _Record:
    try:
        values: Any = json_of(text)
    except ValueError as error:
        raise ArtefactError(f"{source} is not JSON: {error}") from error
    given = [field for field in fields(kind) if field.init]
    # A field with a default may be younger than the file.
    required = {field.name for field in given if field.default is MISSING}
    if not isinstance(values, dict) or not required <= values.keys():
        missing = sorted(required - values.keys()) if isinstance(values, dict) else sorted(required)
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
