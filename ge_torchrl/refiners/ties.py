"""Ties: which numbers of a tree that is its own mirror image are one number.

Such a tree has about half as many free numbers as numbers: each split, and each leaf, is tied to its image.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.refiners.folding import half_of, numbered, whole_of
from ge_torchrl.refiners.mirror import Mirror
from ge_torchrl.trees.nodes import Nodes, Split
from ge_torchrl.trees.parameters import has_free_weight
from ge_torchrl.trees.tree import DecisionTree

# A split or the entries of a leaf, as weights of features and a constant.
_Form = tuple[dict[int, float], float]


@dataclass(frozen=True, eq=False)
class Ties:
    """The free numbers of a tree: parameter `i` is `sign[i]` times free number `free[i]`, or 0 where `sign[i]` is 0.

    Attributes:
        free: [N] int64, from 0 to one less than there are free numbers.
        sign: [N] float64, 1, -1 or 0.
    """

    free: NDArray[np.int64]
    sign: NDArray[np.float64]

    @classmethod
    def none(cls, n_parameters: int) -> Ties:
        """Return the ties of a tree whose numbers are all free."""
        return cls(np.arange(n_parameters), np.ones(n_parameters))

    @property
    def leading(self) -> NDArray[np.int64]:
        """[n] the first parameter of each free number; its sign is 1."""
        used = np.flatnonzero(self.sign)
        _, first = np.unique(self.free[used], return_index=True)
        return used[first]

    def parameters(self, numbers: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return parameters [..., N] of free numbers [..., n]."""
        if numbers.shape[-1] == 0:
            return np.zeros((*numbers.shape[:-1], len(self.free)))
        parameters: NDArray[np.float64] = numbers[..., self.free] * self.sign
        return parameters


def ties_in(tree: DecisionTree, mirror: Mirror | None) -> Ties:
    """Return the ties of a tree in the mirror of its environment; no number is tied where either is missing.

    Args:
        tree: The tree.
        mirror: Of the environment; None where it has none.
    """
    ties = None if mirror is None else ties_of(tree, mirror)
    return Ties.none(len(tree.parameters)) if ties is None else ties


def ties_of(tree: DecisionTree, mirror: Mirror) -> Ties | None:
    """Return the ties of a tree that is its own mirror image; None for any other tree.

    A split's image is the split with mirrored weights and the same threshold, or its complement, with all of that
    negated. A tree is its own image where each split has its image among the splits, and each leaf answers in the
    mirror what a leaf answers to which the images of its splits lead. So is a tree that folds, in whose two halves
    one split may stand twice.

    Args:
        tree: The tree.
        mirror: Of the environment.
    """
    half = half_of(tree, mirror)
    if half is not None:
        return _ties_of_half(half, mirror)
    images = _images_of_splits(tree, mirror)
    leaves = None if images is None else _images_of_leaves(tree, mirror, images)
    if images is None or leaves is None:
        return None
    tied = _Tied(len(tree.parameters))
    _tie_splits(tree, mirror, images, tied)
    if not tree.has_actions:
        _tie_leaves(tree, mirror, leaves, tied)
    return tied.ties()


def _ties_of_half(half: Nodes, mirror: Mirror) -> Ties | None:
    """Return the ties of the tree whose half it is: those thresholds are tied that come from one of the half's."""
    whole = whole_of(numbered(half, mirror), mirror)
    if whole is None:
        return None
    tied = _Tied(sum(isinstance(node, Split) for node in whole))
    first: dict[float, tuple[int, float]] = {}
    for place, number in enumerate(node.threshold for node in whole if isinstance(node, Split)):
        one, its_number = first.setdefault(abs(number), (place, number))
        # What is at 0 stays there: it is its own negative.
        tied.tie(one, place, 1 if number != 0 and number == its_number else -1)
    return tied.ties()


def _images_of_splits(tree: DecisionTree, mirror: Mirror) -> list[tuple[int, int]] | None:
    """Return the image of each split, and 1, or -1 for a complement."""
    forms = [_split_form(tree, split) for split in range(tree.num_decision_nodes)]
    images = []
    for weights, threshold in forms:
        mirrored = mirror.weights(weights)
        matches = [
            (other, side)
            for side in (1, -1)
            for other, (its_weights, its_threshold) in enumerate(forms)
            if its_threshold == side * threshold and its_weights == {f: side * w for f, w in mirrored.items()}
        ]
        if not matches:
            return None
        images.append(matches[0])
    return images


def _images_of_leaves(
    tree: DecisionTree, mirror: Mirror, images: Sequence[tuple[int, int]]
) -> list[int] | None:
    """Return the image of each leaf: it answers the mirrored answer, and the paths to both do not contradict."""
    paths = _paths(tree)
    found = []
    for leaf, path in enumerate(paths):
        mirrored = {
            images[split][0]: went_left == (images[split][1] > 0) for split, went_left in path.items()
        }
        matches = [
            other
            for other, its_path in enumerate(paths)
            if (its_path.items() <= mirrored.items() or mirrored.items() <= its_path.items())
            and _answers_in_mirror(tree, mirror, leaf, other)
        ]
        if not matches:
            return None
        found.append(matches[0])
    return found


def _paths(tree: DecisionTree) -> list[dict[int, bool]]:
    """Return, for each leaf, the splits above it and whether it lies on their left."""
    paths: list[dict[int, bool]] = [{} for _ in range(tree.num_leaves)]
    todo: list[tuple[int, dict[int, bool]]] = [(0 if tree.num_decision_nodes else ~0, {})]
    while todo:
        node, path = todo.pop()
        if node < 0:
            paths[~node] = path
        else:
            todo.append((int(tree.children_left[node]), {**path, node: True}))
            todo.append((int(tree.children_right[node]), {**path, node: False}))
    return paths


def _split_form(tree: DecisionTree, split: int) -> _Form:
    terms = slice(tree.term_start[split], tree.term_start[split + 1])
    weights = dict(zip(tree.feature[terms].tolist(), tree.weight[terms].tolist(), strict=True))
    return weights, float(tree.threshold[split])


def _leaf_form(tree: DecisionTree, leaf: int, entry: int) -> _Form:
    terms = slice(tree.leaf_term_start[leaf], tree.leaf_term_start[leaf + 1])
    weights = dict(
        zip(tree.leaf_feature[terms].tolist(), tree.leaf_weight[terms, entry].tolist(), strict=True)
    )
    return weights, float(tree.value[leaf, entry])


def _answers_in_mirror(tree: DecisionTree, mirror: Mirror, leaf: int, other: int) -> bool:
    if tree.has_actions:
        return bool(mirror.action[tree.action[leaf]] == tree.action[other])
    for entry in range(tree.value.shape[1]):
        weights, value = _leaf_form(tree, leaf, entry)
        sign = float(mirror.action_sign[entry])
        image = {f: sign * w for f, w in mirror.weights(weights).items()}, sign * value
        if image != _leaf_form(tree, other, int(mirror.action[entry])):
            return False
    return True


def _tie_splits(tree: DecisionTree, mirror: Mirror, images: Sequence[tuple[int, int]], tied: _Tied) -> None:
    place = np.full(len(tree.feature), -1)
    free = np.flatnonzero(has_free_weight(tree.arrays))
    place[free] = tree.num_decision_nodes + np.arange(len(free))
    for split, (other, side) in enumerate(images):
        tied.tie(split, other, side)
        its = {int(tree.feature[k]): int(place[k]) for k in _range(tree.term_start, other)}
        for k in _range(tree.term_start, split):
            if place[k] >= 0:
                feature = int(tree.feature[k])
                tied.tie(int(place[k]), its[int(mirror.feature[feature])], side * int(mirror.sign[feature]))


def _tie_leaves(tree: DecisionTree, mirror: Mirror, images: Sequence[int], tied: _Tied) -> None:
    n_entries = tree.value.shape[1]
    first_value = len(tree.parameters) - tree.value.size - tree.leaf_weight.size
    first_weight = first_value + tree.value.size
    for leaf, other in enumerate(images):
        its = {int(tree.leaf_feature[q]): q for q in _range(tree.leaf_term_start, other)}
        for entry in range(n_entries):
            image, sign = int(mirror.action[entry]), int(mirror.action_sign[entry])
            tied.tie(first_value + leaf * n_entries + entry, first_value + other * n_entries + image, sign)
            for q in _range(tree.leaf_term_start, leaf):
                feature = int(tree.leaf_feature[q])
                mirrored = its[int(mirror.feature[feature])]
                tied.tie(
                    first_weight + q * n_entries + entry,
                    first_weight + mirrored * n_entries + image,
                    sign * int(mirror.sign[feature]),
                )


def _range(start: NDArray[np.int32], row: int) -> range:
    return range(int(start[row]), int(start[row + 1]))


class _Tied:
    """Parameters that are joined to groups; within a group each is the group's number or its negative, or all are 0."""

    def __init__(self, n: int) -> None:
        self._group = np.arange(n)
        self._sign = np.ones(n)

    def tie(self, one: int, other: int, sign: int) -> None:
        """Make one parameter `sign` times another."""
        group, into = sorted((self._group[one], self._group[other]), reverse=True)
        ratio = self._sign[one] * sign * self._sign[other]
        if group == into:
            if ratio < 0:
                self._sign[self._group == group] = 0.0
            return
        members = self._group == group
        self._sign[members] *= ratio
        if ratio == 0:
            self._sign[self._group == into] = 0.0
        self._group[members] = into

    def ties(self) -> Ties:
        """Return the ties, the free numbers in the order of their first parameters."""
        used = self._sign != 0
        free = np.zeros(len(self._group), np.int64)
        free[used] = np.unique(self._group[used], return_inverse=True)[1]
        return Ties(free, self._sign)
