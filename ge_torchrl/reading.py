"""Files that somebody else may have made, read with limits.

No pipe that waits, no device without an end, no text that takes all memory, no number or nesting that ends the reader.
"""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from ge_torchrl.errors import ArtefactError
from ge_torchrl.printing import shortened

MOST_BYTES = 256 << 20
"""Of a file that a run writes; the longest are episodes step by step."""
MOST_SETTINGS_BYTES = 8 << 20
"""Of a file of settings, grammars included."""
_MOST_VALUES = 1_000_000
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


def read_bytes(path: str | os.PathLike[str], at_most: int = MOST_BYTES) -> bytes:
    """Return what a file holds.

    Args:
        path: The file.
        at_most: Bytes that it may have.

    Raises:
        ArtefactError: There is no such file, it is none but a folder, a pipe or a device, or it is too large.
    """
    try:
        found = Path(path).stat()
        if kind := next((kind for belongs, kind in _KINDS if belongs(found.st_mode)), None):
            raise ArtefactError(f"{name_of(path)} must be a file; it is {kind}")
        if found.st_size > at_most:
            raise _too_large(path, at_most)
        with Path(path).open("rb") as file:
            # A file may grow meanwhile, and some of the system's tell no size.
            content = file.read(at_most + 1)
    except OSError as error:
        raise ArtefactError(f"{name_of(path)} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ArtefactError(f"{name_of(path)} cannot be read: {error}") from error
    if len(content) > at_most:
        raise _too_large(path, at_most)
    return content


def _too_large(path: str | os.PathLike[str], at_most: int) -> ArtefactError:
    return ArtefactError(
        f"{name_of(path)} must have at most {at_most >> 20} MiB, because it is read whole; it has more"
    )


def read_text(path: str | os.PathLike[str], at_most: int = MOST_BYTES) -> str:
    """Return a file's text; see `read_bytes`.

    Raises:
        ArtefactError: It cannot be read, or it is not text in UTF-8.
    """
    try:
        return read_bytes(path, at_most).decode("utf-8")
    except UnicodeDecodeError as error:
        raise ArtefactError(f"{name_of(path)} is not text in UTF-8: {error}") from error


def name_of(path: str | os.PathLike[str]) -> str:
    """Return a path as a message shows it."""
    return shortened(os.fspath(path), 300)


def json_of(text: str) -> Any:
    """Return what a text in JSON says.

    Raises:
        ValueError: It is no JSON, holds a key twice, nests too deep or has too many digits; the message is one line.
    """
    try:
        return json.loads(text, object_pairs_hook=_object)
    except RecursionError:
        raise ValueError("it nests too deep") from None


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Refuse a key that stands twice: two readers of such a file may read two things."""
    content = dict(pairs)
    if len(content) != len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"{shortened(twice)!r} stands {keys.count(twice)} times in one object")
    return content


class YAMLLoader(yaml.SafeLoader):
    """Makes plain values, and refuses a key that stands twice in one mapping, as Hydra does."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Return the mapping of a node."""
        keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        if len(set(keys)) < len(keys):
            twice = next(key for key in keys if keys.count(key) > 1)
            raise ValueError(f"{shortened(str(twice))!r} stands {keys.count(twice)} times in one mapping")
        return super().construct_mapping(node, deep=deep)


def yaml_of(text: str, loader: type[yaml.SafeLoader] = YAMLLoader) -> Any:
    """Return what a text in YAML says: plain values, by a loader that makes no others.

    Raises:
        ValueError: It is no YAML, holds a key twice, nests too deep, has too many digits, or repeats its parts so often
            that they take all memory; the message is one line.
    """
    try:
        values = yaml.load(text, loader)  # noqa: S506 (a safe loader)
    except RecursionError:
        raise ValueError("it nests too deep") from None
    except yaml.YAMLError as error:
        raise ValueError(" ".join(str(error).split())) from error
    # An alias stands for a whole part: a text of a kilobyte may say as much as fills a disk.
    if _n_values(values, {}) > _MOST_VALUES:
        raise ValueError(f"it says more than {_MOST_VALUES} values, aliases counted as what they stand for")
    return values


def _n_values(values: Any, known: dict[int, float]) -> float:
    """Return how many values there are, what stands twice counted twice; a part that holds itself has no end."""
    if not isinstance(values, list | Mapping | tuple | set):
        return 1
    if id(values) not in known:
        known[id(values)] = float("inf")
        parts = values.values() if isinstance(values, Mapping) else values
        known[id(values)] = 1 + sum(_n_values(part, known) for part in parts)
    return known[id(values)]


def is_folder(path: str | os.PathLike[str]) -> bool:
    """Tell whether there is a folder; a path that no system takes, such as one of 5,000 characters, names none."""
    return os.path.isdir(path)  # noqa: PTH112 (pathlib raises there)


def is_there(path: str | os.PathLike[str]) -> bool:
    """Tell whether something has this path, be it a link that leads nowhere."""
    return os.path.lexists(path)
