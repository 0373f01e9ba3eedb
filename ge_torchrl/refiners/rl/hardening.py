"""The way back: from soft trees to hard ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray

from ge_torchrl.refiners.rl.splits import SoftSplits
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

HardNumbers: TypeAlias = Mapping[str, NDArray[Any]]
"""Thresholds [R, M], weights [R, M, K], actions [R, L], values [R, L, A], their linear weights [R, L, Q, A]: those of
them that a training moves, padded, by their names in `ForestArrays`."""


@torch.no_grad()
def hard_numbers(splits: SoftSplits) -> HardNumbers:
    """Return the numbers of the hard trees, padded."""
    parts = splits.hard_parts()
    return {
        name: part.float().numpy() if part.is_floating_point() else part.numpy()
        for name, part in parts.items()
    }


def are_finite(numbers: HardNumbers) -> NDArray[np.bool_]:
    """Return [R], whether all numbers of a tree are finite."""
    are: NDArray[np.bool_] = np.all(
        [np.isfinite(part).reshape(len(part), -1).all(1) for part in numbers.values()], 0
    )
    return are


def chosen(is_first: NDArray[np.bool_], first: HardNumbers, second: HardNumbers) -> HardNumbers:
    """Return the numbers of the first where `is_first` [R], else of the second."""
    return {
        name: np.where(is_first.reshape(-1, *[1] * (part.ndim - 1)), part, second[name])
        for name, part in first.items()
    }


class HardForest:
    """Hard trees of one structure each, with whatever numbers.

    Args:
        trees: [R] the trees.
        numbers: Numbers of soft trees that were made of them.

    Attributes:
        numbers: The trees' own, padded.
    """

    def __init__(self, trees: Sequence[DecisionTree], numbers: HardNumbers) -> None:
        self._arrays = Forest.stack(trees).arrays
        self._is_own = {
            name: _is_own(part.shape, [_LENGTHS[name](tree) for tree in trees])
            for name, part in numbers.items()
        }
        for name, part in numbers.items():
            part[self._is_own[name]] = getattr(self._arrays, name)
        self.numbers = numbers

    def with_numbers(self, numbers: HardNumbers) -> Forest:
        """Return the trees with other numbers."""
        own = {name: part[self._is_own[name]] for name, part in numbers.items()}
        return Forest(self._arrays._replace(**own))


# How many numbers of a kind are a tree's own: one number, or one for each split or leaf.
_LENGTHS: Mapping[str, Callable[[DecisionTree], Any]] = {
    "threshold": lambda tree: tree.num_decision_nodes,
    "weight": lambda tree: np.diff(tree.term_start),
    "action": lambda tree: tree.num_leaves,
    "value": lambda tree: tree.num_leaves,
    "leaf_weight": lambda tree: np.diff(tree.leaf_term_start),
}


def _is_own(shape: tuple[int, ...], lengths: Sequence[Any]) -> NDArray[np.bool_]:
    """Return [R, N] or [R, N, K], False where there is padding behind so many numbers."""
    filled = np.zeros(shape[: 1 + np.ndim(lengths[0])], np.int64)
    for place, own in zip(filled if filled.ndim > 1 else filled[:, np.newaxis], lengths, strict=True):
        place[: np.size(own)] = own
    is_own: NDArray[np.bool_] = np.arange(shape[filled.ndim]) < filled[..., np.newaxis]
    return is_own
