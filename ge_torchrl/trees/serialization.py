"""Trees as files: the format `ge_torchrl.tree/1`, JSON for persons and programs."""

from __future__ import annotations

import json
import os
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ge_torchrl.errors import ArtefactError, InvalidTreeError
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.labels import TreeLabels
from ge_torchrl.trees.rendering import check_labels, shortest_decimal

FORMAT = "ge_torchrl.tree/1"

_INDEX_KEYS = ("feature", "children_left", "children_right", "action")
_KEYS = ("format", "environment", *_INDEX_KEYS, "threshold", "provenance")
_ENVIRONMENT_KEYS = ("id", "features", "units", "actions")
_INT32 = np.iinfo(np.int32)
# The least number that rounds to infinity: the decimal of the largest float32 may lie above that float32.
_OVERFLOW = 2.0**128 - 2.0**103


@dataclass(frozen=True)
class TreeDocument:
    """A tree with all that a reader needs to understand it.

    Attributes:
        tree: the tree.
        labels: the names of the environment's features and actions.
        provenance: where the tree comes from (run, seed, generation, ...): any JSON object. It is copied.

    Raises:
        InvalidTreeError: The tree does not fit the labels, or the provenance is no JSON.
    """

    tree: DecisionTree
    labels: TreeLabels
    provenance: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        check_labels(self.tree, self.labels)
        try:
            copied = json.loads(json.dumps(dict(self.provenance), allow_nan=False))
        except (TypeError, ValueError, RecursionError) as error:
            raise InvalidTreeError(
                f"provenance: expected a JSON object of finite values, got {error}"
            ) from error
        object.__setattr__(self, "provenance", copied)


def to_json(document: TreeDocument) -> str:
    """Return the text of a document: equal documents give equal text.

    Args:
        document: the tree, its labels and its provenance.

    Returns:
        JSON with one array a line, thresholds as the shortest decimals that read back as the same float32.
    """
    tree, labels = document.tree, document.labels
    environment = {
        "id": labels.environment,
        "features": labels.features,
        "units": labels.units,
        "actions": labels.actions,
    }
    arrays = {
        "feature": tree.feature.tolist(),
        "threshold": [shortest_decimal(threshold) for threshold in tree.threshold],
        "children_left": tree.children_left.tolist(),
        "children_right": tree.children_right.tolist(),
        "action": tree.action.tolist(),
    }
    entries = {
        "format": _line(FORMAT),
        "environment": _lines({key: _line(value) for key, value in environment.items()}, indent="  "),
        **{key: _line(values) for key, values in arrays.items()},
        "provenance": _lines(
            {key: _line(value) for key, value in sorted(document.provenance.items())}, indent="  "
        ),
    }
    return _lines(entries) + "\n"


def from_json(text: str, source: str = "<text>") -> TreeDocument:
    """Return the document that a text describes; thresholds are rounded to float32.

    Args:
        text: JSON in the format `ge_torchrl.tree/1`.
        source: the text's name in messages.

    Raises:
        InvalidTreeError: The text is not in the format; the message names the source and the key.
    """
    try:
        return _document(_parsed(text))
    except InvalidTreeError as error:
        raise InvalidTreeError(f"{source}: {error}") from error


def read_tree(path: str | os.PathLike[str]) -> TreeDocument:
    """Return the document in a file.

    Raises:
        ArtefactError: The file is missing or unreadable.
        InvalidTreeError: Its text is not in the format `ge_torchrl.tree/1`.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise ArtefactError(f"{os.fspath(path)}: cannot read the tree: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InvalidTreeError(
            f"{os.fspath(path)}: expected JSON in UTF-8, got other bytes: {error}"
        ) from error
    return from_json(text, source=os.fspath(path))


def write_tree(path: str | os.PathLike[str], document: TreeDocument) -> None:
    """Write a document to a file, whole or not at all.

    Args:
        path: the file; an old one is replaced.
        document: the tree, its labels and its provenance.

    Raises:
        ArtefactError: The file cannot be written; an old one is still there.
    """
    target = Path(path)
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        try:
            temporary.write_text(to_json(document), encoding="utf-8", newline="\n")
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise ArtefactError(f"{target}: cannot write the tree: {error.strerror}") from error


def _line(value: object) -> str:
    return json.dumps(value, allow_nan=False, sort_keys=True)


def _lines(entries: Mapping[str, str], indent: str = "") -> str:
    """Return a JSON object of values already written, one a line."""
    if not entries:
        return "{}"
    body = ",\n".join(f"{indent}  {_line(key)}: {text}" for key, text in entries.items())
    return f"{{\n{body}\n{indent}}}"


def _parsed(text: str) -> dict[str, Any]:
    try:
        content = json.loads(text, object_pairs_hook=_object)
    except json.JSONDecodeError as error:
        raise InvalidTreeError(f"expected JSON, but {error}") from error
    except (ValueError, RecursionError) as error:
        raise InvalidTreeError(f"expected JSON of reasonable size, but {error}") from error
    if not isinstance(content, dict):
        raise InvalidTreeError(f"expected a JSON object, got {_shown(content)}")
    return content


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Refuse a key that stands twice: the two readers of such a file may read two trees."""
    content = dict(pairs)
    if len(content) != len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise InvalidTreeError(
            f"{twice}: expected once, but it stands {keys.count(twice)} times in one object"
        )
    return content


def _document(content: dict[str, Any]) -> TreeDocument:
    # The version comes first: another version may have other keys.
    if content.get("format") != FORMAT:
        raise InvalidTreeError(
            f"format: expected {FORMAT!r}, the version read here, got {_shown(content.get('format'))}"
        )
    _check_keys(content, _KEYS, "the document")
    arrays: dict[str, Any] = {key: _indices(content[key], key) for key in _INDEX_KEYS}
    arrays["threshold"] = _thresholds(content["threshold"])
    n_nodes = len(arrays["feature"])
    for key, values in arrays.items():
        if len(values) != n_nodes:
            raise InvalidTreeError(f"{key}: expected {n_nodes} entries, as feature has, got {len(values)}")
    provenance = content["provenance"]
    if not isinstance(provenance, dict):
        raise InvalidTreeError(f"provenance: expected an object, got {_shown(provenance)}")
    return TreeDocument(
        tree=DecisionTree(**arrays), labels=_labels(content["environment"]), provenance=provenance
    )


def _labels(environment: object) -> TreeLabels:
    if not isinstance(environment, dict):
        raise InvalidTreeError(f"environment: expected an object, got {_shown(environment)}")
    _check_keys(environment, _ENVIRONMENT_KEYS, "environment")
    if not isinstance(environment["id"], str):
        raise InvalidTreeError(f"environment.id: expected a string, got {_shown(environment['id'])}")
    features, units, actions = (
        tuple(_strings(environment[key], f"environment.{key}")) for key in ("features", "units", "actions")
    )
    return TreeLabels(environment=environment["id"], features=features, units=units, actions=actions)


def _check_keys(content: Mapping[str, Any], expected: tuple[str, ...], where: str) -> None:
    if missing := [key for key in expected if key not in content]:
        raise InvalidTreeError(f"{missing[0]}: expected in {where}, but it is missing")
    if unknown := [key for key in content if key not in expected]:
        raise InvalidTreeError(
            f"{_shown(unknown[0])}: not a key of {where}; its keys are {', '.join(expected)}"
        )


def _indices(values: object, key: str) -> list[int]:
    # JSON's true is an int to Python, so the type itself is asked for.
    for place, value in enumerate(_array(values, key)):
        if type(value) is not int or not _INT32.min <= value <= _INT32.max:
            raise InvalidTreeError(f"{key}[{place}]: expected a 32-bit integer, got {_shown(value)}")
    return _array(values, key)


def _thresholds(values: object) -> list[float]:
    for place, value in enumerate(_array(values, "threshold")):
        # NaN is not within the range either.
        if type(value) not in (int, float) or not -_OVERFLOW < value < _OVERFLOW:
            raise InvalidTreeError(
                f"threshold[{place}]: expected a finite float32 number, got {_shown(value)}"
            )
    return [float(value) for value in _array(values, "threshold")]


def _strings(values: object, key: str) -> list[str]:
    for place, value in enumerate(_array(values, key)):
        if not isinstance(value, str):
            raise InvalidTreeError(f"{key}[{place}]: expected a string, got {_shown(value)}")
    return _array(values, key)


def _array(values: object, key: str) -> list[Any]:
    if not isinstance(values, list):
        raise InvalidTreeError(f"{key}: expected an array, got {_shown(values)}")
    return values


def _shown(value: object) -> str:
    return reprlib.repr(value)
