"""Trees on many episodes: part by part, so that memory has a bound, and who waits can be told how far it is."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import Backend
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

# Returns of so many episodes are in memory at a time: 160 MB.
_MOST_RETURNS: Final = 20_000_000
# Episodes of a tree before it is first told how far it is; twice as many each time, where they take less than so long.
_PART, _PART_SECONDS = 1000, 1.0

Told = Callable[[int, int], None]
"""Is told again and again how many episodes are done, and how many there are."""


def tell_nobody(_done: int, _all: int) -> None:
    """Do nothing."""


class Meter:
    """Measures trees in an environment, and tells how far it is.

    Args:
        backend: The environment.
        n_all: Episodes of all trees together that it will be asked for.
        told: Is told how many are done.
    """

    def __init__(self, backend: Backend, n_all: int, told: Told) -> None:
        self._backend, self._n_all, self._told = backend, n_all, told
        self._n_done = 0

    def returns(
        self, trees: Sequence[DecisionTree], seeds: NDArray[np.int64], purpose: str
    ) -> NDArray[np.float64]:
        """Return what each tree returned in each episode, [P, E]."""
        forest, returns = Forest.stack(trees), np.empty((len(trees), len(seeds)))
        first, size = 0, _PART
        while first < len(seeds):
            part, started = slice(first, first + size), time.perf_counter()
            returns[:, part] = self._backend.evaluate(forest, seeds[part], purpose).returns
            self._n_done += len(trees) * len(seeds[part])
            self._told(self._n_done, self._n_all)
            first += size
            if time.perf_counter() - started < _PART_SECONDS:
                size *= 2
        return returns

    def means(
        self, trees: Sequence[DecisionTree], seeds: NDArray[np.int64], purpose: str
    ) -> dict[DecisionTree, tuple[float, float]]:
        """Return the mean of each tree's returns, and their standard deviation."""
        found: dict[DecisionTree, tuple[float, float]] = {}
        at_a_time = max(1, _MOST_RETURNS // len(seeds))
        for first in range(0, len(trees), at_a_time):
            some = trees[first : first + at_a_time]
            for tree, returns in zip(some, self.returns(some, seeds, purpose), strict=True):
                found[tree] = float(returns.mean()), float(returns.std())
        return found
