"""A small Python file that makes a scikit-learn tree: no pickle, so that every version reads it and a person too."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.errors import UserError
from ge_torchrl.exports.code import clipped_constants, summary
from ge_torchrl.exports.extras import INSTALL, UNVERIFIED, MissingToolError
from ge_torchrl.exports.modules import loaded
from ge_torchrl.exports.numbers import float64_text
from ge_torchrl.exports.python import docstring, texts_literal
from ge_torchrl.exports.written import Written
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.tree import FloatArray

_CLASSIFIER = """\
    model = DecisionTreeClassifier()
    model.fit(np.zeros((len(ACTIONS), len(FEATURES))), np.arange(len(ACTIONS)))
"""
_REGRESSOR = """\
    model = DecisionTreeRegressor()
    model.fit(np.zeros((1, len(FEATURES))), np.zeros((1, len(ACTIONS))))
"""
_TEXT = '''\
"""{summary}

Ask it by {predict}; `sklearn.tree.plot_tree` and
`export_text` draw it with `feature_names=FEATURES`.

The tree goes left where a feature is below its threshold, scikit-learn where it is at most its own. So
each threshold here is the float32 before that of the tree: on float32 both are the same.
"""

import numpy as np
from sklearn.tree import {estimator}

FEATURES = {features}
UNITS = {units}
ACTIONS = {actions}
# Left child, right child, feature, threshold; a child of -1 makes a leaf.
NODES = [
{nodes}
]
# {values_are}, of each node; those of splits are not used.
VALUES = [
{values}
]


def {name}():
    """Return the tree as a fitted {estimator}."""
{fitted}\
    # A fitted tree keeps its size, so that the nodes go into a new one.
    empty, arguments, state = model.tree_.__reduce__()
    nodes = np.zeros(len(NODES), state["nodes"].dtype)
    nodes["left_child"], nodes["right_child"], nodes["feature"], nodes["threshold"] = zip(*NODES)
    nodes["n_node_samples"] = nodes["weighted_n_node_samples"] = 1
    values = np.array(VALUES, float).reshape(len(NODES), *state["values"].shape[1:])
    state.update(max_depth={depth}, node_count=len(NODES), nodes=nodes, values=values)
    model.tree_ = empty(*arguments)
    model.tree_.__setstate__(state)
    return model
'''


def write(controller: Controller, name: str) -> bytes:
    """Return a module with a function that makes the tree.

    Args:
        controller: The controller.
        name: The name of the function.

    Raises:
        UserError: Some split is a weighted sum, or some leaf is linear.
    """
    tree, names = controller.tree, controller.names
    if not tree.is_axis_aligned or len(tree.leaf_feature):
        has = "linear leaves" if tree.is_axis_aligned else "weighted sums in its splits"
        raise UserError(
            "--to sklearn expects splits that compare one feature and leaves with actions or constants, "
            f"because scikit-learn's trees have no others; this tree has {has}; --to onnx takes every tree"
        )
    rows = list(_nodes(controller))
    classes = "Weights of the actions" if tree.has_actions else "Values of the action"
    return _TEXT.format(
        summary=docstring(summary(controller)),
        predict=f"`{name}().predict([observation])`",
        estimator="DecisionTreeClassifier" if tree.has_actions else "DecisionTreeRegressor",
        fitted=_CLASSIFIER if tree.has_actions else _REGRESSOR,
        features=texts_literal(names.features),
        units=texts_literal(names.units),
        actions=texts_literal(names.actions),
        nodes="\n".join(f"    {node}," for node, _ in rows),
        values="\n".join(f"    {values}," for _, values in rows),
        values_are=classes,
        name=name,
        depth=tree.depth,
    ).encode()


def answers(written: Sequence[Written], observed: Sequence[FloatArray]) -> list[NDArray[Any]]:
    """Return what scikit-learn answers to [B, D] observations of each tree.

    Raises:
        MissingToolError: scikit-learn is not installed.
    """
    if find_spec("sklearn") is None:
        raise MissingToolError(f"a scikit-learn tree is verified with scikit-learn; {INSTALL}; {UNVERIFIED}")
    found: list[NDArray[Any]] = []
    for one, rows in zip(written, observed, strict=True):
        # It adds all numbers to see whether they are finite, and complains of its own sum.
        with np.errstate(over="ignore", invalid="ignore"):
            predicted = getattr(loaded(one.content), one.name)().predict(rows)
        tree = one.controller.tree
        found.append(predicted if tree.has_actions else predicted.reshape(len(rows), -1).astype(np.float32))
    return found


def _nodes(controller: Controller) -> Iterator[tuple[str, list[float]]]:
    """Yield each node and its values, the splits before the leaves."""
    tree, n_splits = controller.tree, controller.tree.num_decision_nodes
    leaves = (
        np.eye(len(controller.names.actions))[tree.action]
        if tree.has_actions
        else clipped_constants(controller)
    )
    for split in range(n_splits):
        left, right = (
            int(child) if child >= 0 else n_splits + int(~child)
            for child in (tree.children_left[split], tree.children_right[split])
        )
        before = np.nextafter(tree.threshold[split], np.float32(-np.inf))
        # Nothing is below the least float32.
        text = float64_text(before) if np.isfinite(before) else "-np.inf"
        yield f"({left}, {right}, {tree.feature[split]}, {text})", [0.0] * leaves.shape[1]
    for values in leaves.tolist():
        yield "(-1, -1, -2, -2.0)", values
