"""Reading the format `ge_torchrl.tree/2`: whatever a text holds, a controller or one line that names the key."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.controller import Controller, Names
from ge_torchrl.trees.format_1 import FORMAT_1
from ge_torchrl.trees.json_values import (
    array,
    integer,
    keyed,
    mapping,
    number,
    numbers,
    shown,
    string,
    strings,
)
from ge_torchrl.trees.rows import starts
from ge_torchrl.trees.tree import DecisionTree

FORMAT = "ge_torchrl.tree/2"

_KEYS = ("format", "environment", "splits", "leaves", "provenance")
_ENVIRONMENT = ("id", "kwargs", "wrappers", "max_episode_steps", "features", "units", "actions")


def controller_of_format_2(content: dict[str, Any]) -> Controller:
    """Return the controller of a document.

    Raises:
        InvalidTreeError: It is not in the format; the message names the key.
    """
    if content.get("format") != FORMAT:
        raise InvalidTreeError(
            f"format: expected {FORMAT!r} or {FORMAT_1!r}, the versions read here, "
            f"got {shown(content.get('format'))}"
        )
    keyed(content, _KEYS, "")
    names = _names(content["environment"])
    return Controller(_tree(content), names, mapping(content["provenance"], "provenance"))


def _names(value: object) -> Names:
    # Where actions are choices there are no bounds, and installed environments have no source; nor have older files.
    environment = keyed(value, _ENVIRONMENT, "environment", optional=("action_bounds", "source"))
    limit = environment["max_episode_steps"]
    return Names(
        id=string(environment["id"], "environment.id"),
        kwargs=mapping(environment["kwargs"], "environment.kwargs"),
        max_episode_steps=None if limit is None else integer(limit, "environment.max_episode_steps"),
        features=strings(environment["features"], "environment.features"),
        units=strings(environment["units"], "environment.units"),
        actions=strings(environment["actions"], "environment.actions"),
        wrappers=strings(environment["wrappers"], "environment.wrappers"),
        action_bounds=_action_bounds(environment.get("action_bounds", [])),
        source=string(environment.get("source", ""), "environment.source"),
    )


def _action_bounds(value: object) -> tuple[tuple[float, float], ...]:
    bounds = []
    for place, entry in enumerate(array(value, "environment.action_bounds")):
        key = f"environment.action_bounds[{place}]"
        ends = array(entry, key)
        if len(ends) != 2:
            raise InvalidTreeError(f"{key}: expected the least and the greatest value, got {shown(entry)}")
        low, high = (None if end is None else number(end, f"{key}[{side}]") for side, end in enumerate(ends))
        bounds.append((-math.inf if low is None else low, math.inf if high is None else high))
    return tuple(bounds)


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
