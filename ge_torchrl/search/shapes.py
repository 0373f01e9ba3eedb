"""What dense starts look like: few splits over all features, and leaves that answer every action.

Where the environment has a mirror, each is its own mirror image: a split comes with its image, or is its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.refiners.mirror import Mirror
from ge_torchrl.trees.tree import DecisionTree

# More numbers than these have are found sooner by growing what is there.
MOST_SPLITS: Final = 3
"""Splits of the largest start."""

# How often leaves that might be linear are constants: some tasks are done best by full force this way or that.
_CONSTANT_PROBABILITY: Final = 0.5

_Weights = dict[int, float]
# The features that a sum is of: all, or those parts of it that keep or change their sign in the mirror.
_WHOLE, _EVEN, _ODD = "whole", "even", "odd"


@dataclass(frozen=True, eq=False)
class Shapes:
    """Draws dense starts.

    Attributes:
        spread: [D] how far each feature spreads, above 0.
        n_actions: Number of actions, or of entries of a continuous one.
        half_range: [A] half the range of each entry of a continuous action, 1 where it is infinite; [0] where actions
            are discrete.
        mirror: Of the environment; None where it has none.
        oblique: Whether a split weighs all features, or compares one.
        linear: Whether values of leaves are linear in features, or constants.
        most_splits: Splits of the largest trees.
    """

    spread: NDArray[np.float64]
    n_actions: int
    half_range: NDArray[np.float64]
    mirror: Mirror | None
    oblique: bool
    linear: bool
    most_splits: int = MOST_SPLITS

    def draw(self, rng: np.random.Generator) -> DecisionTree:
        """Return a tree whose numbers are drawn too, so that no two of them are equal by chance.

        The sum of a split spreads about as far as 1.
        """
        if len(self.half_range) > 0:
            return self._of_values(rng)
        if self.mirror is None or not self._sum(_ODD, rng):
            return self._of_actions(rng)
        return self._of_actions_in_mirror(rng, self.mirror)

    def units(self, tree: DecisionTree) -> NDArray[np.float64]:
        """Return a natural step of each parameter of a start, [N]: a leaf's values are as large as actions."""
        units = tree.parameter_units(self.spread)
        if not tree.has_actions:
            n_leaf_rows = tree.num_leaves + len(tree.leaf_feature)
            units[len(units) - n_leaf_rows * self.n_actions :] *= np.tile(self.half_range, n_leaf_rows)
        return units

    def _of_actions(self, rng: np.random.Generator) -> DecisionTree:
        """Return a chain of splits, each of which leads to another action."""
        actions = rng.permutation(self.n_actions)[: 1 + min(self.n_actions - 1, self.most_splits)].tolist()
        tree = DecisionTree.leaf(actions.pop())
        for action in actions:
            tree = self._split(self._sum(_WHOLE, rng), rng.normal(), DecisionTree.leaf(action), tree)
        return tree

    def _of_actions_in_mirror(self, rng: np.random.Generator, mirror: Mirror) -> DecisionTree:
        """Return a chain of splits that is its own image: two for a pair of mirrored actions, one for any other."""
        pairs = [(a, int(b)) for a, b in enumerate(mirror.action) if a < b]
        alone = [a for a, b in enumerate(mirror.action.tolist()) if a == b]
        even = self._sum(_EVEN, rng)
        blocks: list[Sequence[int]] = [*pairs, *([a] for a in alone)]
        order = [blocks[i] for i in rng.permutation(len(blocks)).tolist()]
        # A chain ends in an action that is its own image, or in a split between a pair.
        last = next((block for block in order if len(block) == 1), order[0])
        room = self.most_splits - (len(last) - 1)
        tree = DecisionTree.leaf(last[0])
        if len(last) == 2:
            tree = self._split(self._sum(_ODD, rng), 0.0, tree, DecisionTree.leaf(last[1]))
        for block in order:
            if block is last or len(block) > room or (len(block) == 1 and not even):
                continue
            room -= len(block)
            if len(block) == 1:
                tree = self._split(self._sum(_EVEN, rng), rng.normal(), DecisionTree.leaf(block[0]), tree)
                continue
            weights, threshold = self._sum(_ODD, rng), rng.normal()
            tree = self._split(mirror.weights(weights), threshold, DecisionTree.leaf(block[1]), tree)
            tree = self._split(weights, threshold, DecisionTree.leaf(block[0]), tree)
        return tree

    def _of_values(self, rng: np.random.Generator) -> DecisionTree:
        """Return a leaf, or a split or two between leaves."""
        mirror = self.mirror
        if mirror is None:
            linear = self.linear and rng.random() >= _CONSTANT_PROBABILITY
            tree = self._leaf(rng, linear=linear)
            for _ in range(int(rng.integers(min(2, self.most_splits) + 1))):
                leaf = self._leaf(rng, linear=linear)
                tree = self._split(self._sum(_WHOLE, rng), rng.normal(), leaf, tree)
            return tree
        kind = int(rng.integers(3)) if self.most_splits > 0 else 0
        if kind == 1 and (odd := self._sum(_ODD, rng)):
            value, terms = self._values(rng, linear=self.linear)
            image = _image_of_leaf(mirror, value, terms)
            return self._split(
                odd, 0.0, DecisionTree.value_leaf(value, terms), DecisionTree.value_leaf(*image)
            )
        tree = self._leaf(rng, linear=self.linear)
        if kind == 2 and (even := self._sum(_EVEN, rng)):
            tree = self._split(even, rng.normal(), self._leaf(rng, linear=self.linear), tree)
        return tree

    def _split(
        self, weights: _Weights, threshold: float, left: DecisionTree, right: DecisionTree
    ) -> DecisionTree:
        return DecisionTree.weighted_split(list(weights), list(weights.values()), threshold, left, right)

    def _sum(self, part: str, rng: np.random.Generator) -> _Weights:
        """Draw the weights of a sum that spreads about as far as 1, or of a lone feature; empty where there is none."""
        drawn = _as_floats(rng.normal(size=len(self.spread)) / self.spread)
        weights = self._part(part, dict(enumerate(drawn)))
        if not weights:
            return {}
        if not self.oblique:
            # A feature whose image is another one cannot keep or change its sign alone.
            lone = [
                f for f in weights if part == _WHOLE or self.mirror is None or self.mirror.feature[f] == f
            ]
            return {int(rng.choice(lone)): 1.0} if lone else {}
        if len(weights) == 1:
            return dict.fromkeys(weights, 1.0)
        length = float(np.sqrt(sum((w * self.spread[f]) ** 2 for f, w in weights.items())))
        return {f: float(np.float32(w / length)) for f, w in weights.items()}

    def _part(self, part: str, weights: _Weights) -> _Weights:
        if part == _WHOLE or self.mirror is None:
            return weights
        side = 1.0 if part == _EVEN else -1.0
        image = self.mirror.weights(weights)
        halves = {f: 0.5 * (w + side * image[f]) for f, w in weights.items()}
        return {f: w for f, w in halves.items() if w != 0}

    def _leaf(self, rng: np.random.Generator, *, linear: bool) -> DecisionTree:
        """Return a leaf of random values, its own image where there is a mirror."""
        value, terms = self._values(rng, linear=linear)
        if self.mirror is not None:
            image_value, image_terms = _image_of_leaf(self.mirror, value, terms)
            value = [0.5 * (one + other) for one, other in zip(value, image_value, strict=True)]
            terms = {
                f: [0.5 * (one + other) for one, other in zip(weights, image_terms[f], strict=True)]
                for f, weights in terms.items()
            }
        return DecisionTree.value_leaf(value, {f: weights for f, weights in terms.items() if any(weights)})

    def _values(
        self, rng: np.random.Generator, *, linear: bool
    ) -> tuple[list[float], dict[int, list[float]]]:
        value = _as_floats(rng.normal(size=self.n_actions) * self.half_range)
        if not linear:
            return value, {}
        drawn = (
            rng.normal(size=(len(self.spread), self.n_actions)) * self.half_range / self.spread[:, np.newaxis]
        )
        return value, dict(enumerate(drawn.astype(np.float32).tolist()))


def _image_of_leaf(
    mirror: Mirror, value: list[float], linear: dict[int, list[float]]
) -> tuple[list[float], dict[int, list[float]]]:
    """Return the values and linear terms of a leaf's image."""

    def answered(entries: list[float], sign: float) -> list[float]:
        return [
            sign * float(mirror.action_sign[a]) * entries[int(mirror.action[a])] for a in range(len(entries))
        ]

    terms = {
        int(mirror.feature[f]): answered(weights, float(mirror.sign[f])) for f, weights in linear.items()
    }
    return answered(value, 1.0), dict(sorted(terms.items()))


def _as_floats(numbers: NDArray[np.float64]) -> list[float]:
    """Round to float32: what is equal but for its sign stays so in a tree."""
    rounded: list[float] = numbers.astype(np.float32).tolist()
    return rounded
