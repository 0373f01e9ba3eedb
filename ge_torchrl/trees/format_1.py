"""The format `ge_torchrl.tree/1`, which is read and no more written: splits and leaves numbered together."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.controller import Controller, Names
from ge_torchrl.trees.json_values import integers, keyed, mapping, numbers, string, strings
from ge_torchrl.trees.tree import DecisionTree

FORMAT_1 = "ge_torchrl.tree/1"
_ARRAYS = ("feature", "threshold", "children_left", "children_right", "action")
_ENVIRONMENT = ("id", "features", "units", "actions")


def controller_of_format_1(content: dict[str, Any]) -> Controller:
    """Return the controller of a document in the old format.

    Raises:
        InvalidTreeError: It is not in the format; the message names the key.
    """
    keyed(content, ("format", "environment", *_ARRAYS, "provenance"), "")
    environment = keyed(content["environment"], _ENVIRONMENT, "environment")
    features, units, actions = (
        strings(environment[key], f"environment.{key}") for key in ("features", "units", "actions")
    )
    return Controller(
        tree=_tree(content),
        names=Names(string(environment["id"], "environment.id"), features, units, actions),
        provenance=mapping(content["provenance"], "provenance"),
    )


def _tree(content: dict[str, Any]) -> DecisionTree:
    """Number splits and leaves apart; in the old arrays -1 means: no child, no feature, no action."""
    feature, left, right, action = (
        np.array(integers(content[key], key), np.int64)
        for key in ("feature", "children_left", "children_right", "action")
    )
    threshold = np.array(numbers(content["threshold"], "threshold"))
    n_nodes = len(feature)
    for key, of in (
        ("threshold", threshold),
        ("children_left", left),
        ("children_right", right),
        ("action", action),
    ):
        if len(of) != n_nodes:
            raise InvalidTreeError(f"{key}: expected {n_nodes} entries, as feature has, got {len(of)}")
    if n_nodes == 0:
        raise InvalidTreeError("feature: expected at least one node, got none")
    leaf = left == -1
    _refuse(leaf != (right == -1), "children_right", "a node has two children or none (-1)")
    _refuse(leaf != (feature == -1), "feature", "-1 stands at leaves and nowhere else")
    _refuse(leaf != (action != -1), "action", "-1 stands at decision nodes and nowhere else")
    _refuse(leaf & (threshold != 0), "threshold", "0 stands at leaves")
    for key, children in (("children_left", left), ("children_right", right)):
        outside = ~leaf & ((children < 1) | (children >= n_nodes))
        _refuse(outside, key, f"children are nodes 1 to {n_nodes - 1} (the root is nobody's child)")
    number = np.where(leaf, ~(np.cumsum(leaf) - 1), np.cumsum(~leaf) - 1)
    if leaf[0] and n_nodes > 1:
        raise InvalidTreeError(
            f"children_left[0]: the root is a leaf, so the other {n_nodes - 1} nodes have no place"
        )
    try:
        return DecisionTree.axis_aligned(
            feature[~leaf], threshold[~leaf], number[left[~leaf]], number[right[~leaf]], action[leaf]
        )
    except InvalidTreeError as error:
        raise InvalidTreeError(f"children_left, children_right: {error}") from error


def _refuse(bad: NDArray[np.bool_], key: str, rule: str) -> None:
    if bad.any():
        raise InvalidTreeError(f"{key}[{int(np.argmax(bad))}]: {rule}")
