"""A tree as a person reads it: with the environment's names, units and the shortest decimals."""

from __future__ import annotations

import numpy as np

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.labels import TreeLabels


def render_text(tree: DecisionTree, labels: TreeLabels) -> str:
    """Return the tree drawn with lines, one node a line, each decision as a question.

    Args:
        tree: the tree.
        labels: the names of its features and actions.

    Returns:
        Lines without a trailing newline; a lone leaf reads `always left`.

    Raises:
        InvalidTreeError: The tree uses a feature or an action that the labels do not have.
    """
    check_labels(tree, labels)
    if tree.n_nodes == 1:
        return f"always {labels.actions[tree.action[0]]}"
    lines: list[str] = []
    # A node, what stands in front of its own line, and in front of the lines below it.
    open_nodes = [(0, "", "")]
    while open_nodes:
        node, front, below = open_nodes.pop()
        if tree.is_leaf[node]:
            lines.append(front + labels.actions[tree.action[node]])
            continue
        feature, threshold = tree.feature[node], shortest_decimal(tree.threshold[node])
        lines.append(front + _condition(labels, int(feature), None, threshold) + "?")
        open_nodes.append((int(tree.children_right[node]), below + "└─ no:  ", below + "        "))
        open_nodes.append((int(tree.children_left[node]), below + "├─ yes: ", below + "│       "))
    return "\n".join(lines)


def render_rules(tree: DecisionTree, labels: TreeLabels) -> str:
    """Return one rule a leaf, its conditions on one feature joined into one interval.

    A leaf that no observation reaches shows an empty interval; `simplify_exact` removes such leaves.

    Args:
        tree: the tree.
        labels: the names of its features and actions.

    Returns:
        Lines such as `if -0.1 <= theta < 0.2 rad and x < 1 m then left`, features in the order in which the
        path first tests them; a lone leaf reads `always left`.

    Raises:
        InvalidTreeError: The tree uses a feature or an action that the labels do not have.
    """
    check_labels(tree, labels)
    if tree.n_nodes == 1:
        return f"always {labels.actions[tree.action[0]]}"
    lines: list[str] = []
    open_nodes: list[tuple[int, dict[int, tuple[float, float]]]] = [(0, {})]
    while open_nodes:
        node, intervals = open_nodes.pop()
        if tree.is_leaf[node]:
            conditions = [
                _condition(labels, feature, low if low > -np.inf else None, high if high < np.inf else None)
                for feature, (low, high) in intervals.items()
            ]
            lines.append(f"if {' and '.join(conditions)} then {labels.actions[tree.action[node]]}")
            continue
        feature, threshold = int(tree.feature[node]), shortest_decimal(tree.threshold[node])
        low, high = intervals.get(feature, (-np.inf, np.inf))
        open_nodes.append(
            (int(tree.children_right[node]), {**intervals, feature: (max(low, threshold), high)})
        )
        open_nodes.append(
            (int(tree.children_left[node]), {**intervals, feature: (low, min(high, threshold))})
        )
    return "\n".join(lines)


def check_labels(tree: DecisionTree, labels: TreeLabels) -> None:
    """Refuse a tree that uses a feature or an action that the labels do not have.

    Raises:
        InvalidTreeError: It does; the message names the node.
    """
    for what, used, names in (
        ("feature", tree.feature, labels.features),
        ("action", tree.action, labels.actions),
    ):
        node = int(np.argmax(used))
        if used[node] >= len(names):
            raise InvalidTreeError(
                f"{what}[{node}]: {labels.environment} has {what}s 0 to {len(names) - 1}, not {used[node]}"
            )


def shortest_decimal(threshold: float | np.float32) -> float:
    """Return the shortest decimal that reads back as the same float32: 0.0154, not 0.015399999916553497.

    Args:
        threshold: a finite float32.

    Returns:
        A Python float `d` with `np.float32(d) == threshold` and as few digits as that allows.
    """
    value = np.float32(threshold)
    # Rounded up, the largest float32 overflows, and then it is not equal either.
    with np.errstate(over="ignore"):
        decimals = (float(f"{value:.{digits}g}") for digits in range(1, 18))
        return next(decimal for decimal in decimals if np.float32(decimal) == value)


def _condition(labels: TreeLabels, feature: int, low: float | None, high: float | None) -> str:
    """Return `low <= name < high unit`, or the one side of it that is given."""
    name, unit = labels.features[feature], labels.units[feature]
    if high is None:
        text = f"{name} >= {_number(low)}"
    elif low is None:
        text = f"{name} < {_number(high)}"
    else:
        text = f"{_number(low)} <= {name} < {_number(high)}"
    return f"{text} {unit}".rstrip()


def _number(value: float | None) -> str:
    return repr(value).removesuffix(".0")
