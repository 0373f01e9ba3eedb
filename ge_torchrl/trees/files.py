"""Controllers as files: the format `ge_torchrl.tree/2`, JSON for persons and programs."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ge_torchrl.errors import ArtefactError, InvalidTreeError
from ge_torchrl.reading import name_of, read_text
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.format_1 import FORMAT_1, controller_of_format_1
from ge_torchrl.trees.format_2 import FORMAT, controller_of_format_2
from ge_torchrl.trees.json_values import parsed
from ge_torchrl.trees.text import shortest_decimal
from ge_torchrl.trees.tree import DecisionTree

__all__ = ["FORMAT", "from_json", "read_controller", "to_json", "write_controller"]

# A tree of a million nodes has as many.
_MOST_BYTES = 128 << 20
_ENVIRONMENT_KEYS = ("id", "kwargs", "wrappers", "max_episode_steps", "features", "units", "actions")


def to_json(controller: Controller) -> str:
    """Return the text of a controller: equal controllers give equal text.

    Args:
        controller: The tree, its names and its provenance.

    Returns:
        JSON with one split or leaf a line, numbers as the shortest decimals that read back as the same float32.
    """
    tree, names = controller.tree, controller.names
    environment = {key: _sorted_line(getattr(names, key)) for key in _ENVIRONMENT_KEYS}
    if names.action_bounds:
        environment["action_bounds"] = _line([[_bound(end) for end in ends] for ends in names.action_bounds])
    if names.source:
        environment["source"] = _line(names.source)
    provenance = {key: _sorted_line(value) for key, value in sorted(controller.provenance.items())}
    entries = {
        "format": _line(FORMAT),
        "environment": _lines(environment, indent="  "),
        "splits": _array_lines(_split(tree, split) for split in range(tree.num_decision_nodes)),
        "leaves": _array_lines(_leaf(tree, leaf) for leaf in range(tree.num_leaves)),
        "provenance": _lines(provenance, indent="  "),
    }
    return _lines(entries) + "\n"


def from_json(text: str, source: str = "<text>") -> Controller:
    """Return the controller that a text describes; numbers are rounded to float32.

    Args:
        text: JSON in the format `ge_torchrl.tree/2`, or in its predecessor `ge_torchrl.tree/1`.
        source: The text's name in messages.

    Raises:
        InvalidTreeError: The text is not in the format; the message names the source and the key.
    """
    try:
        content = parsed(text)
        # The version comes first: another version has other keys.
        if content.get("format") == FORMAT_1:
            return controller_of_format_1(content)
        return controller_of_format_2(content)
    except InvalidTreeError as error:
        raise InvalidTreeError(f"{source}: {error}") from error


def read_controller(path: str | os.PathLike[str]) -> Controller:
    """Return the controller in a file.

    Raises:
        ArtefactError: The file is missing, unreadable, too large or no text in UTF-8.
        InvalidTreeError: Its text is not in the format `ge_torchrl.tree/2` or `/1`.
    """
    return from_json(read_text(path, _MOST_BYTES), source=name_of(path))


def write_controller(path: str | os.PathLike[str], controller: Controller) -> None:
    """Write a controller to a file, whole or not at all.

    Args:
        path: The file; an old one is replaced.
        controller: The tree, its names and its provenance.

    Raises:
        ArtefactError: The file cannot be written; an old one is still there.
    """
    target = Path(path)
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        try:
            temporary.write_text(to_json(controller), encoding="utf-8", newline="\n")
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise ArtefactError(f"{target}: cannot write the tree: {error.strerror}") from error


def _split(tree: DecisionTree, split: int) -> dict[str, Any]:
    terms = range(tree.term_start[split], tree.term_start[split + 1])
    return {
        "terms": [
            {"feature": int(tree.feature[term]), "weight": shortest_decimal(tree.weight[term])}
            for term in terms
        ],
        "threshold": shortest_decimal(tree.threshold[split]),
        "left": int(tree.children_left[split]),
        "right": int(tree.children_right[split]),
    }


def _leaf(tree: DecisionTree, leaf: int) -> dict[str, Any]:
    if tree.has_actions:
        return {"action": int(tree.action[leaf])}
    terms = range(tree.leaf_term_start[leaf], tree.leaf_term_start[leaf + 1])
    return {
        "value": [shortest_decimal(value) for value in tree.value[leaf]],
        "linear": [
            {
                "feature": int(tree.leaf_feature[term]),
                "weights": [shortest_decimal(weight) for weight in tree.leaf_weight[term]],
            }
            for term in terms
        ],
    }


def _bound(end: float) -> float | None:
    """Return the end of an interval, None where it is infinite, since JSON has no infinite numbers."""
    return shortest_decimal(end) if np.isfinite(end) else None


def _line(value: object) -> str:
    return json.dumps(value, allow_nan=False)


def _sorted_line(value: object) -> str:
    """Return what a user gave, whose order says nothing."""
    return json.dumps(value, allow_nan=False, sort_keys=True)


def _lines(entries: Mapping[str, str], indent: str = "") -> str:
    """Return a JSON object of values already written, one a line."""
    if not entries:
        return "{}"
    body = ",\n".join(f"{indent}  {_line(key)}: {text}" for key, text in entries.items())
    return f"{{\n{body}\n{indent}}}"


def _array_lines(entries: Iterable[object]) -> str:
    """Return a JSON array, one entry a line."""
    body = ",\n".join(f"    {_line(entry)}" for entry in entries)
    return f"[\n{body}\n  ]" if body else "[]"
