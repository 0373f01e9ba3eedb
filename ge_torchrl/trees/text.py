"""A tree as a person reads it: with the environment's names, units and the shortest decimals."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ge_torchrl.trees.controller import Names, check_names
from ge_torchrl.trees.tree import DecisionTree

# The terms of a split, as (feature, weight).
_Terms = tuple[tuple[int, float], ...]
_FACTORS = {1.0: "", -1.0: "-"}


def render_text(tree: DecisionTree, names: Names) -> str:
    """Return the tree drawn with lines, one split or leaf a line, each split as a question.

    Args:
        tree: The tree.
        names: The names of its features and actions.

    Returns:
        Lines without a trailing newline; a lone leaf reads `always left`.

    Raises:
        InvalidTreeError: The tree uses a feature or an action that the names do not have.
    """
    check_names(tree, names)
    if tree.num_decision_nodes == 0:
        return f"always {leaf_text(tree, names, 0)}"
    lines: list[str] = []
    # A node, what stands in front of its own line, and in front of the lines below it.
    open_nodes = [(0, "", "")]
    while open_nodes:
        node, front, below = open_nodes.pop()
        if node < 0:
            lines.append(front + leaf_text(tree, names, ~node))
            continue
        lines.append(front + split_text(tree, names, node) + "?")
        open_nodes.append((int(tree.children_right[node]), below + "└─ no:  ", below + "        "))
        open_nodes.append((int(tree.children_left[node]), below + "├─ yes: ", below + "│       "))
    return "\n".join(lines)


def render_rules(tree: DecisionTree, names: Names) -> str:
    """Return one rule a leaf, its conditions on one feature, or on one sum, joined into one interval.

    A leaf that no observation reaches shows an empty interval; `simplify` removes such leaves.

    Args:
        tree: The tree.
        names: The names of its features and actions.

    Returns:
        Lines such as `if -0.1 <= theta < 0.2 rad and x < 1 m then left`, conditions in the order in which the
        path first tests them; a lone leaf reads `always left`.

    Raises:
        InvalidTreeError: The tree uses a feature or an action that the names do not have.
    """
    check_names(tree, names)
    if tree.num_decision_nodes == 0:
        return f"always {leaf_text(tree, names, 0)}"
    lines: list[str] = []
    open_nodes: list[tuple[int, dict[_Terms, tuple[float, float]]]] = [(0, {})]
    while open_nodes:
        node, intervals = open_nodes.pop()
        if node < 0:
            conditions = " and ".join(
                _condition(names, terms, low, high) for terms, (low, high) in intervals.items()
            )
            lines.append(f"if {conditions} then {leaf_text(tree, names, ~node)}")
            continue
        terms, threshold = _terms(tree, node), shortest_decimal(tree.threshold[node])
        low, high = intervals.get(terms, (-np.inf, np.inf))
        right = {**intervals, terms: (max(low, threshold), high)}
        left = {**intervals, terms: (low, min(high, threshold))}
        open_nodes += ((int(tree.children_right[node]), right), (int(tree.children_left[node]), left))
    return "\n".join(lines)


def clipping_text(tree: DecisionTree, names: Names) -> str:
    """Return between which bounds answers are clipped; empty where no leaf may answer what lies outside of them."""
    bounds = names.action_bounds
    if tree.has_actions or not np.isfinite(bounds).any():
        return ""
    low, high = np.array(bounds, np.float32).T
    if len(tree.leaf_feature) == 0 and ((low <= tree.value) & (tree.value <= high)).all():
        return ""
    spans = [f"{low:.6g} to {high:.6g}" for low, high in bounds]
    if len(set(spans)) > 1:
        spans = [f"{name} {span}" for name, span in zip(names.actions, spans, strict=True)]
    return f"values are clipped to {', '.join(dict.fromkeys(spans))}"


def split_text(tree: DecisionTree, names: Names, split: int) -> str:
    """Return what a split asks: `theta < 0.2 rad`, or `2 x - 0.5 theta < 0.2`."""
    return _condition(names, _terms(tree, split), -np.inf, shortest_decimal(tree.threshold[split]))


def leaf_text(tree: DecisionTree, names: Names, leaf: int) -> str:
    """Return what a leaf answers: the name of its action, or `force = 0.5 + 2 x` for each value."""
    return ", ".join(leaf_lines(tree, names, leaf))


def leaf_lines(tree: DecisionTree, names: Names, leaf: int) -> list[str]:
    """Return the same with one line for each value."""
    if tree.has_actions:
        return [names.actions[int(tree.action[leaf])]]
    terms = slice(tree.leaf_term_start[leaf], tree.leaf_term_start[leaf + 1])
    answers = []
    for column, name in enumerate(names.actions):
        weights = tree.leaf_weight[terms, column]
        linear = [
            (int(feature), shortest_decimal(weight))
            for feature, weight in zip(tree.leaf_feature[terms], weights, strict=True)
            if weight != 0
        ]
        constant = shortest_decimal(tree.value[leaf, column])
        texts = [_number(constant)] if constant != 0 or not linear else []
        answers.append(f"{name} = {_sum([*texts, *_products(names, linear)])}")
    return answers


def shortest_decimal(number: float | np.float32) -> float:
    """Return the shortest decimal that reads back as the same float32: 0.0154, not 0.015399999916553497.

    Args:
        number: A finite float32.

    Returns:
        A Python float `d` with `np.float32(d) == number` and as few digits as that allows.
    """
    value = np.float32(number)
    # Rounded up, the largest float32 overflows, and then it is not equal either.
    with np.errstate(over="ignore"):
        decimals = (float(f"{value:.{digits}g}") for digits in range(1, 18))
        return next(decimal for decimal in decimals if np.float32(decimal) == value)


def _terms(tree: DecisionTree, split: int) -> _Terms:
    terms = range(tree.term_start[split], tree.term_start[split + 1])
    return tuple((int(tree.feature[term]), shortest_decimal(tree.weight[term])) for term in terms)


def _condition(names: Names, terms: _Terms, low: float, high: float) -> str:
    """Return `low <= sum < high unit`, or the one side of it that is finite; a unit only where all terms share it."""
    summed = _sum(_products(names, terms))
    if high == np.inf:
        text = f"{summed} >= {_number(low)}"
    elif low == -np.inf:
        text = f"{summed} < {_number(high)}"
    else:
        text = f"{_number(low)} <= {summed} < {_number(high)}"
    units = {names.units[feature] for feature, _ in terms}
    return f"{text} {units.pop()}".rstrip() if len(units) == 1 else text


def _products(names: Names, terms: Iterable[tuple[int, float]]) -> list[str]:
    """Return `x`, `-x` or `2 x` for each term."""
    return [
        _FACTORS.get(weight, f"{_number(weight)} ") + names.features[feature] for feature, weight in terms
    ]


def _sum(texts: list[str]) -> str:
    first, *others = texts
    return first + "".join(f" - {text[1:]}" if text.startswith("-") else f" + {text}" for text in others)


def _number(value: float) -> str:
    return repr(value).removesuffix(".0")
