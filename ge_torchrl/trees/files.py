"""Controllers as files: the format `ge_torchrl.tree/2`, JSON for persons and programs."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ge_torchrl.errors import ArtefactError, InvalidTreeError
from ge_torchrl.trees.controller import Controller, Names
from ge_torchrl.trees.format_1 import FORMAT_1, controller_of_format_1
from ge_torchrl.trees.json_values import (
    array,
    integer,
    keyed,
    mapping,
    number,
    numbers,
    parsed,
    shown,
    string,
    strings,
)
from ge_torchrl.trees.rows import starts
from ge_torchrl.trees.text import shortest_decimal
from ge_torchrl.trees.tree import DecisionTree

FORMAT = "ge_torchrl.tree/2"

_KEYS = ("format", "environment", "splits", "leaves", "provenance")
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
        return _controller(content)
    except InvalidTreeError as error:
        raise InvalidTreeError(f"{source}: {error}") from error


def read_controller(path: str | os.PathLike[str]) -> Controller:
    """Return the controller in a file.

    Raises:
        ArtefactError: The file is missing or unreadable.
        InvalidTreeError: Its text is not in the format `ge_torchrl.tree/2` or `/1`.
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


def _controller(content: dict[str, Any]) -> Controller:
    if content.get("format") != FORMAT:
        raise InvalidTreeError(
            f"format: expected {FORMAT!r} or {FORMAT_1!r}, the versions read here, "
            f"got {shown(content.get('format'))}"
        )
    keyed(content, _KEYS, "")
    names = _names(content["environment"])
    return Controller(_tree(content), names, mapping(content["provenance"], "provenance"))


def _names(value: object) -> Names:
    environment = keyed(value, _ENVIRONMENT_KEYS, "environment")
    limit = environment["max_episode_steps"]
    return Names(
        id=string(environment["id"], "environment.id"),
        kwargs=mapping(environment["kwargs"], "environment.kwargs"),
        max_episode_steps=None if limit is None else integer(limit, "environment.max_episode_steps"),
        features=strings(environment["features"], "environment.features"),
        units=strings(environment["units"], "environment.units"),
        actions=strings(environment["actions"], "environment.actions"),
        wrappers=strings(environment["wrappers"], "environment.wrappers"),
    )


def _tree(content: dict[str, Any]) -> DecisionTree:
    splits = array(content["splits"], "splits")
    leaves = array(content["leaves"], "leaves")
    if len(leaves) != len(splits) + 1:
        raise InvalidTreeError(
            f"leaves: expected {len(splits) + 1}, one more than there are splits, got {len(leaves)}"
        )
    arrays = _of_splits(splits) | _of_leaves(leaves)
    try:
        return DecisionTree(**arrays)
    except InvalidTreeError as error:
        raise InvalidTreeError(f"splits: {error}") from error


def _of_splits(splits: list[Any]) -> dict[str, Any]:
    """Return the arrays of `DecisionTree` that splits give."""
    feature: list[int] = []
    weight: list[float] = []
    threshold, n_terms = [], []
    children: dict[str, list[int]] = {"left": [], "right": []}
    for m, entry in enumerate(splits):
        split = keyed(entry, ("terms", "threshold", "left", "right"), f"splits[{m}]")
        terms = array(split["terms"], f"splits[{m}].terms")
        if not terms:
            raise InvalidTreeError(f"splits[{m}].terms: expected at least one term, got none")
        for place, term in enumerate(terms):
            key = f"splits[{m}].terms[{place}]"
            feature.append(_count(keyed(term, ("feature", "weight"), key)["feature"], f"{key}.feature"))
            weight.append(number(term["weight"], f"{key}.weight"))
        n_terms.append(len(terms))
        threshold.append(number(split["threshold"], f"splits[{m}].threshold"))
        for side, of_side in children.items():
            child = integer(split[side], f"splits[{m}].{side}")
            if child == 0 or not ~len(splits) <= child < len(splits):
                raise InvalidTreeError(
                    f"splits[{m}].{side}: expected a split, 1 to {len(splits) - 1} (0 is the root), or a leaf, "
                    f"-1 to {~len(splits)}, got {child}"
                )
            of_side.append(child)
    return {
        "children_left": children["left"],
        "children_right": children["right"],
        "term_start": starts(n_terms),
        "feature": feature,
        "weight": weight,
        "threshold": threshold,
    }


def _of_leaves(leaves: list[Any]) -> dict[str, Any]:
    """Return the arrays of `DecisionTree` that leaves give, all of them of the first one's kind."""
    if isinstance(leaves[0], dict) and not leaves[0].keys() & {"value", "linear"}:
        keys = [
            (f"leaves[{place}]", keyed(leaf, ("action",), f"leaves[{place}]"))
            for place, leaf in enumerate(leaves)
        ]
        return {
            "action": [_count(leaf["action"], f"{key}.action") for key, leaf in keys],
            "value": np.zeros((len(leaves), 0)),
            "leaf_term_start": np.zeros(len(leaves) + 1, np.int32),
            "leaf_feature": [],
            "leaf_weight": np.zeros((0, 0)),
        }
    values: list[list[float]] = []
    feature: list[int] = []
    weights: list[list[float]] = []
    n_terms = []
    for place, entry in enumerate(leaves):
        leaf = keyed(entry, ("value", "linear"), f"leaves[{place}]")
        values.append(numbers(leaf["value"], f"leaves[{place}].value"))
        _check_width(values[-1], values[0], f"leaves[{place}].value")
        terms = array(leaf["linear"], f"leaves[{place}].linear")
        for q, term in enumerate(terms):
            key = f"leaves[{place}].linear[{q}]"
            feature.append(_count(keyed(term, ("feature", "weights"), key)["feature"], f"{key}.feature"))
            weights.append(numbers(term["weights"], f"{key}.weights"))
            _check_width(weights[-1], values[0], f"{key}.weights")
        n_terms.append(len(terms))
    return {
        "action": [],
        "value": values,
        "leaf_term_start": starts(n_terms),
        "leaf_feature": feature,
        "leaf_weight": np.array(weights).reshape(len(weights), len(values[0])),
    }


def _count(value: object, key: str) -> int:
    """Return a number that counts from 0."""
    if integer(value, key) < 0:
        raise InvalidTreeError(f"{key}: expected at least 0, got {shown(value)}")
    return integer(value, key)


def _check_width(values: list[float], first: list[float], key: str) -> None:
    if len(values) != len(first) or not values:
        expected = f"{len(first)} numbers, as leaves[0].value has" if first else "at least one number"
        raise InvalidTreeError(f"{key}: expected {expected}, got {len(values)}")
