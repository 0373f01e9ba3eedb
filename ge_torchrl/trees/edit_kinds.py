"""The kinds of edits: each takes the nodes of a tree and returns those of a neighbour."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.trees.arrays import FloatArray
from ge_torchrl.trees.nodes import Leaf, Nodes, Split, Values, end_of

_Any = TypeVar("_Any")

_LARGEST = float(np.finfo(np.float32).max)
# A new term moves what it is added to by a tenth of its spread up to twice its spread.
_LEAST_SHARE, _GREATEST_SHARE = 0.1, 2.0


@dataclass(frozen=True, slots=True)
class Edit:
    """An edit of a tree.

    Attributes:
        nodes: The tree.
        observed: [T, D] float32, finite, what it saw, by leaf.
        leaf_start: Where the rows of each leaf begin; None where that is not known.
        features: Features that new terms may take.
        n_actions: Number of actions.
        rng: Source of randomness.
        bounds: Of each value of a leaf, the least and the greatest, [A]; empty where leaves hold actions.
    """

    nodes: Nodes
    observed: FloatArray
    leaf_start: list[int] | None
    features: Sequence[int] | NDArray[np.int64]
    n_actions: int
    rng: np.random.Generator
    bounds: Sequence[tuple[float, float]] = ()

    def any_of(self, n: int) -> int:
        """Return one of the numbers 0 to n - 1; much quicker than `rng.integers` one by one."""
        return int(self.rng.random() * n)

    def rows_at(self, node: int) -> tuple[int, int]:
        """Return the first row that was seen at a node, and the one behind the last; all rows where none was."""
        first, end = 0, len(self.observed)
        if self.leaf_start is not None:
            before = sum(not isinstance(other, Split) for other in self.nodes[:node])
            leaves = (end_of(self.nodes, node) - node + 1) // 2
            here = self.leaf_start[before], self.leaf_start[before + leaves]
            first, end = here if here[0] < here[1] else (first, end)
        return first, end

    def test_at(self, node: int) -> Split:
        """Return a split: a random feature, and as threshold a value of it that was seen at this node."""
        feature = int(self.features[self.any_of(len(self.features))])
        first, end = self.rows_at(node)
        seen = float(self.observed[first + self.any_of(end - first), feature])
        # Adding zero makes -0.0 into 0.0, as in a tree.
        return Split((feature,), (1.0,), seen + 0.0)

    def one_of(self, places: list[_Any]) -> _Any:
        """Return one of what is given."""
        return places[self.any_of(len(places))]

    def splits(self, n_terms: int = 1) -> list[tuple[int, Split]]:
        """Return the splits of at least so many terms, each with its place."""
        return [
            (node, of)
            for node, of in enumerate(self.nodes)
            if isinstance(of, Split) and len(of.feature) >= n_terms
        ]

    def leaves(self) -> list[tuple[int, Leaf]]:
        """Return the leaves, each with its place."""
        return [(node, of) for node, of in enumerate(self.nodes) if not isinstance(of, Split)]

    def leaves_of_terms(self, n_terms: int) -> list[tuple[int, Values]]:
        """Return the leaves with values and at least so many linear terms, each with its place."""
        return [
            (node, of)
            for node, of in enumerate(self.nodes)
            if isinstance(of, Values) and len(of.feature) >= n_terms
        ]

    def new_feature(self, used: tuple[int, ...]) -> int | None:
        """Return a feature that is not used yet; None where all are."""
        unused = [int(feature) for feature in self.features if feature not in used]
        return self.one_of(unused) if unused else None

    def seen(self, node: int, feature: tuple[int, ...], weight: tuple[float, ...]) -> tuple[float, float]:
        """Return mean and spread of a weighted sum over what was seen at a node; a spread of 1 where it has none."""
        first, end = self.rows_at(node)
        sums = self.observed[first:end][:, list(feature)].astype(np.float64) @ np.array(weight)
        spread = float(sums.std())
        return float(sums.mean()), spread if 0 < spread < math.inf else 1.0

    def new_weight(self, reach: float, spread: float) -> float:
        """Return a weight that moves what spreads as far as `reach` by a part of it, of two digits, of either sign."""
        share = _LEAST_SHARE * (_GREATEST_SHARE / _LEAST_SHARE) ** self.rng.random()
        sign = 1 if self.rng.random() < 0.5 else -1
        return _two_digits(sign * share * reach / spread) or float(sign)

    def reach_of(self, column: int) -> float:
        """Return half of the range of a value; 1 where it has none."""
        low, high = self.bounds[column]
        half = (high - low) / 2
        return half if 0 < half < math.inf else 1.0

    def new_value(self, column: int) -> float:
        """Return a constant within the bounds of a value, of two digits; without both, near 0."""
        low, high = self.bounds[column]
        uniform = self.rng.random()
        drawn = low + (high - low) * uniform if math.isfinite(high - low) else 4 * uniform - 2
        return min(max(_two_digits(drawn), low), high) + 0.0

    def another_leaf(self, first: int, end: int) -> Leaf:
        """Return a random leaf to stand beside the nodes from `first` to `end`.

        Of leaves with values it is one of them with another constant, so that what they know of linear terms stays.
        """
        if not self.bounds:
            return self.any_of(self.n_actions)
        there = [node for node in self.nodes[first:end] if isinstance(node, Values)]
        return self.with_new_constant(self.one_of(there))

    def with_new_constant(self, leaf: Values) -> Values:
        """Return a leaf one of whose constants is drawn anew."""
        column = self.any_of(len(leaf.value))
        return leaf._replace(value=_replaced(leaf.value, column, self.new_value(column)))


def grow(edit: Edit) -> Nodes:
    """Put a new split above a node, mostly a leaf; its other child is a random leaf."""
    nodes = edit.nodes
    at = edit.any_of(len(nodes)) if edit.rng.random() < 0.5 else edit.one_of(edit.leaves())[0]
    end = end_of(nodes, at)
    leaf = edit.another_leaf(at, end)
    halves = [leaf, *nodes[at:end]] if edit.rng.random() < 0.5 else [*nodes[at:end], leaf]
    return [*nodes[:at], edit.test_at(at), *halves, *nodes[end:]]


def test_anew(edit: Edit) -> Nodes:
    """Give a split another feature and threshold."""
    at, _ = edit.one_of(edit.splits())
    return [*edit.nodes[:at], edit.test_at(at), *edit.nodes[at + 1 :]]


def drop(edit: Edit) -> Nodes:
    """Put one of a split's children in its place."""
    nodes, (at, _) = edit.nodes, edit.one_of(edit.splits())
    middle = end_of(nodes, at + 1)
    end = end_of(nodes, middle)
    kept = nodes[at + 1 : middle] if edit.rng.random() < 0.5 else nodes[middle:end]
    return [*nodes[:at], *kept, *nodes[end:]]


def relabel(edit: Edit) -> Nodes:
    """Give a leaf a random action, or another constant."""
    at, old = edit.one_of(edit.leaves())
    new = edit.with_new_constant(old) if isinstance(old, Values) else edit.any_of(edit.n_actions)
    return [*edit.nodes[:at], new, *edit.nodes[at + 1 :]]


def add_term(edit: Edit) -> Nodes:
    """Add a feature to what a split sums, and to its threshold what that adds on average."""
    at, split = edit.one_of(edit.splits())
    feature = edit.new_feature(split.feature)
    if feature is None:
        return test_anew(edit)
    _, reach = edit.seen(at, split.feature, split.weight)
    mean, spread = edit.seen(at, (feature,), (1.0,))
    weight = edit.new_weight(reach, spread)
    new = Split((*split.feature, feature), (*split.weight, weight), _finite(split.threshold + weight * mean))
    return [*edit.nodes[:at], new, *edit.nodes[at + 1 :]]


def drop_term(edit: Edit) -> Nodes:
    """Take a feature from what a split sums, and from its threshold what it added on average."""
    sums = edit.splits(n_terms=2)
    if not sums:
        return add_term(edit)
    at, split = edit.one_of(sums)
    term = edit.any_of(len(split.feature))
    mean, _ = edit.seen(at, (split.feature[term],), (split.weight[term],))
    new = Split(_without(split.feature, term), _without(split.weight, term), _finite(split.threshold - mean))
    return [*edit.nodes[:at], new, *edit.nodes[at + 1 :]]


def add_leaf_term(edit: Edit) -> Nodes:
    """Add a feature to one value of a leaf, and take from its constant what that adds on average."""
    at, leaf = edit.one_of(edit.leaves_of_terms(0))
    feature = edit.new_feature(leaf.feature)
    if feature is None:
        return relabel(edit)
    column = edit.any_of(len(leaf.value))
    mean, spread = edit.seen(at, (feature,), (1.0,))
    weight = edit.new_weight(edit.reach_of(column), spread)
    weights = _replaced((0.0,) * len(leaf.value), column, weight)
    constant = _finite(leaf.value[column] - weight * mean)
    new = Values(_replaced(leaf.value, column, constant), (*leaf.feature, feature), (*leaf.weight, weights))
    return [*edit.nodes[:at], new, *edit.nodes[at + 1 :]]


def drop_leaf_term(edit: Edit) -> Nodes:
    """Take a linear term from a leaf, and add to its constants what it added on average."""
    linear = edit.leaves_of_terms(1)
    if not linear:
        return add_leaf_term(edit)
    at, leaf = edit.one_of(linear)
    term = edit.any_of(len(leaf.feature))
    mean, _ = edit.seen(at, (leaf.feature[term],), (1.0,))
    constants = (
        _finite(constant + weight * mean)
        for constant, weight in zip(leaf.value, leaf.weight[term], strict=True)
    )
    new = Values(tuple(constants), _without(leaf.feature, term), _without(leaf.weight, term))
    return [*edit.nodes[:at], new, *edit.nodes[at + 1 :]]


EDITS: dict[str, Callable[[Edit], Nodes]] = {
    edit.__name__: edit
    for edit in (grow, test_anew, drop, relabel, add_term, drop_term, add_leaf_term, drop_leaf_term)
}


def _finite(number: float) -> float:
    return min(max(number, -_LARGEST), _LARGEST) + 0.0


def _two_digits(number: float) -> float:
    return _finite(float(f"{number:.2g}"))


def _replaced(values: tuple[float, ...], place: int, new: float) -> tuple[float, ...]:
    return (*values[:place], new, *values[place + 1 :])


def _without(values: tuple[_Any, ...], place: int) -> tuple[_Any, ...]:
    return (*values[:place], *values[place + 1 :])
