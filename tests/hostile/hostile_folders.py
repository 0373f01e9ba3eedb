"""Damaged folders of runs: each file in each way, and each value of their records."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

from hostile_verdicts import PASSED, TOLD, Case
from page_runs_for_tests import write_played_run

from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.artefacts.records import ArchiveRecord, GenerationRecord, RefinementRecord, Summary
from ge_torchrl.library.result import load_run
from ge_torchrl.report.html.run_page import run_page
from ge_torchrl.report.reading import read_tree

_DEEP = "[" * 50_000 + "]" * 50_000
_DIGITS = "1" * 5000
_FILES = {
    "config.yaml": "a configuration",
    "history.jsonl": "records",
    "refinements.jsonl": "records",
    "archive.jsonl": "records",
    "summary.json": "a record",
    "best_tree.json": "a tree",
    "best_tree_full.json": "a tree",
    "archive/01.json": "a tree",
    "episodes.json": "episodes",
}
# A record a line: an empty file is a run that refined nothing, or kept no tree.
_MAY_BE_EMPTY = ("refinements.jsonl", "archive.jsonl")


def _bytes(content: bytes | str) -> Callable[[Path], None]:
    raw = content if isinstance(content, bytes) else content.encode()

    def damage(path: Path) -> None:
        path.write_bytes(raw)

    return damage


def _as_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def _as_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def _as_device(path: Path) -> None:
    path.unlink()
    path.symlink_to("/dev/zero")


def _as_circle(path: Path) -> None:
    path.unlink()
    path.symlink_to(path.name)


def _halved(path: Path) -> None:
    half = path.read_bytes()[: path.stat().st_size // 2 - 1]
    # Cut within a line, settings mostly say nothing any more.
    path.write_bytes(half[: half.rindex(b"\n") + 1] if path.suffix == ".yaml" else half)


def _huge(path: Path) -> None:
    # No bytes on the disk: a hole.
    with path.open("r+b") as file:
        file.truncate(10 << 30)


_DAMAGES: dict[str, Callable[[Path], None]] = {
    "empty": _bytes(b""),
    "null": _bytes("null\n"),
    "a number": _bytes("5\n"),
    "a list": _bytes("[]\n"),
    "a text": _bytes('"text"\n'),
    "binary": _bytes(bytes(range(256))),
    "Latin-1": _bytes('{"naïve": "Übung"}\n'.encode("latin-1")),
    "zeros": _bytes(b"\0" * 100),
    "deep": _bytes(_DEEP),
    "5,000 digits": _bytes(f'{{"seed": {_DIGITS}}}'),
    "a folder": _as_folder,
    "a pipe": _as_pipe,
    "a device": _as_device,
    "a link to itself": _as_circle,
    "missing": Path.unlink,
    "half written": _halved,
    "of 10 GiB": _huge,
}

_RECORDS = {
    "summary.json": Summary,
    "history.jsonl": GenerationRecord,
    "refinements.jsonl": RefinementRecord,
    "archive.jsonl": ArchiveRecord,
}
_READERS: dict[str, Callable[[RunFolder], object]] = {
    "summary.json": RunFolder.read_summary,
    "history.jsonl": RunFolder.read_history,
    "refinements.jsonl": RunFolder.read_refinements,
    "archive.jsonl": RunFolder.read_archive,
}
_WRONG: dict[str, Any] = {
    "a text": "abc",
    "null": None,
    "a list": [1],
    "an object": {"a": 1},
    "a truth": True,
    "negative": -3,
    "huge": 10**400,
    "NaN": float("nan"),
    "escape codes": "\x1b[31mred\x1b[0m",
}


def cases(folder: Path) -> Iterator[Case]:
    """Yield all damages of a run's folder, each to a copy of its own below `folder`."""
    sound = write_played_run(folder / "sound").path
    yield Case("a sound run", lambda: _met(sound), PASSED)
    for file in _FILES:
        for name, damage in _DAMAGES.items():
            met = _meeting(sound, folder / "copy", _of_file(file, damage))
            yield Case(f"{file} is {name}", met, _expected(file, name))
    for file, record in _RECORDS.items():
        for field in fields(record):
            for name, wrong in _WRONG.items():
                if field.init and not _is_allowed(str(field.type), wrong):
                    met = _reading(sound / file, folder / file, _keyed(field.name, wrong))
                    yield Case(f"{file}: {field.name} is {name}", met)


def _met(path: Path) -> None:
    """Read a run's folder as every command does that reads one."""
    load_run(path)
    run_page(RunFolder(path))
    read_tree(path, None)


def _meeting(sound: Path, copy: Path, damage: Callable[[Path], None]) -> Callable[[], None]:
    def meet() -> None:
        shutil.copytree(sound, copy)
        damage(copy)
        try:
            _met(copy)
        finally:
            shutil.rmtree(copy)

    return meet


def _reading(sound: Path, copy: Path, damage: Callable[[Path], None]) -> Callable[[], None]:
    def read() -> None:
        shutil.copy(sound, copy)
        damage(copy)
        _READERS[copy.name](RunFolder(copy.parent))

    return read


def _expected(file: str, damage: str) -> str:
    if damage == "empty" and file in _MAY_BE_EMPTY:
        return PASSED
    if damage == "half written" and file in ("config.yaml", "refinements.jsonl"):
        return PASSED  # Cut at the end of a line, both are shorter files of their kind.
    if damage == "missing" and file in ("archive.jsonl", "episodes.json"):
        return PASSED  # A run without an archive, or of an earlier version.
    return TOLD


def _is_allowed(annotation: str, wrong: object) -> bool:
    """Tell whether a wrong value is not wrong for a field of this type."""
    if isinstance(wrong, dict):
        return annotation.startswith("Mapping")
    if wrong is None:
        return "None" in annotation
    if isinstance(wrong, bool):
        return "bool" in annotation
    if isinstance(wrong, str):
        return "str" in annotation and "[" not in annotation
    return isinstance(wrong, int) and wrong == -3 and "float" in annotation


def _of_file(file: str, damage: Callable[[Path], None]) -> Callable[[Path], None]:
    return lambda folder: damage(folder / file)


def _keyed(key: str, wrong: Any) -> Callable[[Path], None]:
    def damage(path: Path) -> None:
        if path.suffix == ".json":
            path.write_text(json.dumps({**json.loads(path.read_text()), key: wrong}))
            return
        first, *others = path.read_text().splitlines()
        path.write_text("\n".join([json.dumps({**json.loads(first), key: wrong}), *others]) + "\n")

    return damage
