"""A tree that a person can read: fewer terms and fewer digits, at the same return.

The sum of a split may be multiplied by anything above 0. So the term that moves it most gets the weight 1, all numbers
are rounded to as few decimals as will do, and terms are left out one after the other for as long as nothing is lost.
Whether something is lost is asked of the same episodes that measured the tree as it was: of few first, so that what is
clearly worse costs little.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import LimitReachedError
from ge_torchrl.refiners.mirror import Mirror
from ge_torchrl.refiners.ties import ties_in
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

Measure = Callable[[Forest, NDArray[np.int64]], NDArray[np.float64]]
"""Gives the returns [P, E] of P trees in the episodes of some seeds [E]."""

# Decimals of a number beyond the size of its unit.
_DECIMALS: Final = (0, 1, 2, 3)
# Parts of the episodes that trees are measured on one after the other, and how many go on to each.
_PARTS: Final = ((0.08, 1000), (0.25, 3), (1.0, 1))
# A tree drops out where it returns less by so many standard errors of the difference: on the first parts clearly less,
# on all episodes hardly less.
_CLEARLY: Final = 1.5
_HARDLY: Final = 0.3
# A thousandth of the return is hardly anything, however sure it is.
_NEXT_TO_NOTHING: Final = 1e-3


class Rounding:
    """Makes one tree easier to read.

    Args:
        tree: The tree.
        mirror: Of the environment, where it has one: numbers that are tied stay so.
        spread: [D] how far each feature spreads, above 0.
        seeds: [E] the episodes that judge.
        measure: Runs trees on some of them.
    """

    def __init__(
        self,
        tree: DecisionTree,
        mirror: Mirror | None,
        spread: NDArray[np.float64],
        seeds: NDArray[np.int64],
        measure: Measure,
    ) -> None:
        self._tree, self._mirror, self._spread = tree, mirror, spread
        self._seeds, self._measure = seeds, measure
        self._returns = np.zeros(0)

    def run(self) -> DecisionTree:
        """Return the tree, rounded as far as it keeps its return, or as the backend's limit leaves room for."""
        tree = self._tree
        with suppress(LimitReachedError):
            self._returns = self._measure(Forest.stack([tree]), self._seeds)[0]
            better = self._rounded(scaled(tree, self._spread))
            while better is not None:
                tree = better
                better = self._best(self._with_a_term_less(tree))
        return tree

    def _rounded(self, tree: DecisionTree) -> DecisionTree | None:
        for decimals in _DECIMALS:
            rounded = self._best([with_decimals(tree, self._spread, decimals)])
            if rounded is not None:
                return rounded
        return None

    def _with_a_term_less(self, tree: DecisionTree) -> list[DecisionTree]:
        """Return the trees in which a term, and those tied to it, has no weight any more."""
        ties = ties_in(tree, self._mirror)
        is_weight = _is_weight(tree)
        trees = []
        for number in range(len(ties.leading)):
            tied = (ties.free == number) & (ties.sign != 0)
            if not is_weight[tied].all():
                continue
            parameters = tree.parameters.copy()
            parameters[tied] = 0.0
            trees.append(without_zero_terms(tree.with_parameters(parameters)))
        return trees

    def _best(self, trees: list[DecisionTree]) -> DecisionTree | None:
        """Return the tree that loses least, if it loses hardly anything on all episodes."""
        returns = [np.zeros(0)] * len(trees)
        left, done = list(range(len(trees))), 0
        for part, n_go_on in _PARTS:
            left = left[:n_go_on]
            until = max(2, round(part * len(self._seeds)))
            more = self._seeds[done:until]
            done = until
            errors = _HARDLY if part == 1.0 else _CLEARLY
            for i in left:
                found = self._measure(Forest.stack([trees[i]]), more)[0]
                returns[i] = np.concatenate([returns[i], found])
            left = [i for i in left if not _is_worse(returns[i], self._returns[:done], errors)]
            left.sort(key=lambda i: -returns[i].mean())
            if not left:
                return None
        return trees[left[0]] if left else None


def _is_worse(returns: NDArray[np.float64], than: NDArray[np.float64], errors: float) -> bool:
    difference = returns - than
    error = difference.std() / np.sqrt(len(difference))
    return bool(difference.mean() < -max(errors * error, _NEXT_TO_NOTHING * abs(than.mean())))


def scaled(tree: DecisionTree, spread: NDArray[np.float64]) -> DecisionTree:
    """Return the tree with each split multiplied so that the term that moves its sum most weighs 1 or -1.

    Args:
        tree: The tree.
        spread: [D] how far each feature spreads.
    """
    weight, threshold = tree.weight.astype(np.float64), tree.threshold.astype(np.float64)
    for split in range(tree.num_decision_nodes):
        terms = slice(tree.term_start[split], tree.term_start[split + 1])
        moves = np.abs(weight[terms]) * spread[tree.feature[terms]]
        if len(moves) > 1 and moves.max() > 0:
            factor = abs(weight[terms][int(np.argmax(moves))])
            weight[terms] /= factor
            threshold[split] /= factor
    return DecisionTree(
        *tree.arrays._replace(weight=weight.astype(np.float32), threshold=threshold.astype(np.float32))
    )


def with_decimals(tree: DecisionTree, spread: NDArray[np.float64], decimals: int) -> DecisionTree:
    """Return the tree with its numbers rounded to so many decimals beyond their units, without terms of weight 0.

    Args:
        tree: The tree.
        spread: [D] how far each feature spreads.
        decimals: 0 rounds a number whose unit is 0.7 to tenths and one whose unit is 2 to whole numbers.
    """
    units = tree.parameter_units(spread)
    places = decimals - np.floor(np.log10(units)).astype(int)
    numbers = [round(float(p), int(k)) for p, k in zip(tree.parameters, places, strict=True)]
    return without_zero_terms(tree.with_parameters(np.array(numbers, np.float32)))


def without_zero_terms(tree: DecisionTree) -> DecisionTree:
    """Return the tree without terms of weight 0, and with one term for each feature of a sum.

    A split without terms goes where a sum of 0 does.
    """
    return _grown(tree, 0 if tree.num_decision_nodes else ~0)


def _grown(tree: DecisionTree, node: int) -> DecisionTree:
    if node < 0:
        return _leaf(tree, ~node)
    terms = range(tree.term_start[node], tree.term_start[node + 1])
    sums = _summed((int(tree.feature[k]), tree.weight[[k]]) for k in terms)
    threshold = float(tree.threshold[node])
    left, right = int(tree.children_left[node]), int(tree.children_right[node])
    if not sums:
        return _grown(tree, left if threshold > 0 else right)
    weight = np.concatenate(list(sums.values()))
    if len(sums) == 1 and len(terms) > 1:
        threshold, weight = threshold / abs(weight[0]), np.sign(weight)
    return DecisionTree.weighted_split(
        list(sums), weight.tolist(), threshold, _grown(tree, left), _grown(tree, right)
    )


def _leaf(tree: DecisionTree, leaf: int) -> DecisionTree:
    if tree.has_actions:
        return DecisionTree.leaf(int(tree.action[leaf]))
    terms = range(tree.leaf_term_start[leaf], tree.leaf_term_start[leaf + 1])
    sums = _summed((int(tree.leaf_feature[q]), tree.leaf_weight[q]) for q in terms)
    return DecisionTree.value_leaf(
        tree.value[leaf].tolist(), {feature: weight.tolist() for feature, weight in sums.items()}
    )


def _summed(terms: Iterable[tuple[int, NDArray[np.float32]]]) -> dict[int, NDArray[np.float64]]:
    """Return the weights of each feature, those of terms that it shares added, but for features of weight 0."""
    sums: dict[int, NDArray[np.float64]] = {}
    for feature, weight in terms:
        sums[feature] = sums.get(feature, np.zeros(len(weight))) + weight
    return {feature: weight for feature, weight in sums.items() if weight.any()}


def _is_weight(tree: DecisionTree) -> NDArray[np.bool_]:
    """Tell which parameters are weights of terms, of splits or of leaves, [N]."""
    is_weight = np.ones(len(tree.parameters), np.bool_)
    is_weight[: tree.num_decision_nodes] = False
    n_values = tree.value.size
    first_value = len(tree.parameters) - n_values - tree.leaf_weight.size
    is_weight[first_value : first_value + n_values] = False
    return is_weight
