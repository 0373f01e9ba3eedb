"""A tree's rule in words, and its sums as formulas."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ge_torchrl.trees.controller import Names
from ge_torchrl.trees.text import leaf_lines, shortest_decimal
from ge_torchrl.trees.tree import DecisionTree

_Terms = tuple[tuple[int, float], ...]
_Interval = tuple[float, float]

_GREEK = {
    "alpha": "\N{GREEK SMALL LETTER ALPHA}",
    "beta": "\N{GREEK SMALL LETTER BETA}",
    "gamma": "\N{GREEK SMALL LETTER GAMMA}",
    "delta": "\N{GREEK SMALL LETTER DELTA}",
    "theta": "\N{GREEK SMALL LETTER THETA}",
    "phi": "\N{GREEK SMALL LETTER PHI}",
    "psi": "\N{GREEK SMALL LETTER PSI}",
    "omega": "\N{GREEK SMALL LETTER OMEGA}",
    "tau": "\N{GREEK SMALL LETTER TAU}",
}
_SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
_SYMBOL = re.compile(rf"(?:(cos|sin)_)?({'|'.join(_GREEK)}|[a-z])(\d*)(_dot)?")
_DOT = "\u0307"


def rules_of(tree: DecisionTree, names: Names) -> list[dict[str, Any]]:
    """Return for each answer the ways that lead to it, in words, in the order in which a person meets them.

    Args:
        tree: The tree.
        names: The names of its features and actions.

    Returns:
        For each answer its `answer` lines, and `ways`: for each leaf that gives it the number of the `leaf` and its
        `conditions`, such as "theta is below 0.2 rad"; none for a lone leaf.
    """
    rules: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for leaf, intervals in _paths(tree):
        conditions = [_condition(names, terms, *interval) for terms, interval in intervals]
        answer = tuple(leaf_lines(tree, names, leaf))
        rules.setdefault(answer, []).append({"leaf": leaf, "conditions": conditions})
    return [{"answer": list(answer), "ways": ways} for answer, ways in rules.items()]


def formulas_of(tree: DecisionTree, names: Names) -> list[dict[str, Any]]:
    """Return one formula for each value that leaves compute: its cases, each a sum and when it holds.

    Args:
        tree: The tree.
        names: The names of its features and actions.

    Returns:
        For each value its `name`, the bounds that it is clipped to, and `cases` of `terms`, a constant as
        `[number, ""]`, and `when`, a list of conditions. None where leaves hold actions or nothing but constants.
    """
    if tree.has_actions or len(tree.leaf_feature) == 0:
        return []
    bounds = names.action_bounds or ((-np.inf, np.inf),) * len(names.actions)
    return [
        {
            "name": symbol(name),
            "low": low if np.isfinite(low) else None,
            "high": high if np.isfinite(high) else None,
            "cases": [
                {
                    "terms": _leaf_terms(tree, names, leaf, column),
                    "when": [
                        _comparison(names, terms, low_end, high_end)
                        for terms, (low_end, high_end) in intervals
                    ],
                }
                for leaf, intervals in _paths(tree)
            ],
        }
        for column, (name, (low, high)) in enumerate(zip(names.actions, bounds, strict=True))
    ]


def symbol(name: str) -> str:
    """Return a name as a formula has it: θ̇ for theta_dot, sin θ₁ for sin_theta1; another name as it is."""
    found = _SYMBOL.fullmatch(name)
    if found is None:
        return name
    function, letter, number, dot = found.groups()
    text = _GREEK.get(letter, letter) + (_DOT if dot else "") + number.translate(_SUBSCRIPTS)
    return f"{function} {text}" if function else text


def _paths(tree: DecisionTree) -> Iterator[tuple[int, list[tuple[_Terms, _Interval]]]]:
    """Yield each leaf from left to right with the interval of each sum on its path, in the order of the tests."""
    open_nodes: list[tuple[int, dict[_Terms, _Interval]]] = [(0 if tree.num_decision_nodes else ~0, {})]
    while open_nodes:
        node, intervals = open_nodes.pop()
        if node < 0:
            yield ~node, list(intervals.items())
            continue
        terms = tuple(
            (int(tree.feature[term]), shortest_decimal(tree.weight[term]))
            for term in range(tree.term_start[node], tree.term_start[node + 1])
        )
        threshold = shortest_decimal(tree.threshold[node])
        low, high = intervals.get(terms, (-np.inf, np.inf))
        right = {**intervals, terms: (max(low, threshold), high)}
        left = {**intervals, terms: (low, min(high, threshold))}
        open_nodes += ((int(tree.children_right[node]), right), (int(tree.children_left[node]), left))


def _condition(names: Names, terms: _Terms, low: float, high: float) -> str:
    what = _sum_text([(weight, names.features[feature]) for feature, weight in terms])
    units = {names.units[feature] for feature, _ in terms}
    unit = f" {units.pop()}" if len(units) == 1 else ""
    if high == np.inf:
        text = f"{what} is at least {_number(low)}{unit}"
    elif low == -np.inf:
        text = f"{what} is below {_number(high)}{unit}"
    else:
        text = f"{what} is from {_number(low)} to below {_number(high)}{unit}"
    return text.rstrip()


def _comparison(names: Names, terms: _Terms, low: float, high: float) -> str:
    what = _sum_text([(weight, symbol(names.features[feature])) for feature, weight in terms])
    if high == np.inf:
        return f"{what} ≥ {_number(low)}"
    left = "" if low == -np.inf else f"{_number(low)} ≤ "
    return f"{left}{what} < {_number(high)}"


def _leaf_terms(tree: DecisionTree, names: Names, leaf: int, column: int) -> list[list[Any]]:
    places = range(tree.leaf_term_start[leaf], tree.leaf_term_start[leaf + 1])
    terms: list[list[Any]] = [
        [shortest_decimal(tree.leaf_weight[place, column]), symbol(names.features[tree.leaf_feature[place]])]
        for place in places
        if tree.leaf_weight[place, column] != 0
    ]
    constant = shortest_decimal(tree.value[leaf, column])
    return [[constant, ""], *terms] if constant != 0 or not terms else terms


def _sum_text(terms: Sequence[tuple[float, str]]) -> str:
    text = ""
    for weight, name in terms:
        sign = ("\u2212" if weight < 0 else "") if not text else (" \u2212 " if weight < 0 else " + ")
        factor = "" if abs(weight) == 1 else f"{_number(abs(weight))} "
        text += f"{sign}{factor}{name}"
    return text


def _number(value: float) -> str:
    return repr(value).removesuffix(".0").replace("-", "\u2212")
