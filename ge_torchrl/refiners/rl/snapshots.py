"""Which hard trees come back from a training: the best ones on the way."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import Backend
from ge_torchrl.refiners.rl.hardening import HardForest, HardNumbers, are_finite, chosen, hard_numbers
from ge_torchrl.refiners.rl.splits import SoftSplits
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.tree import DecisionTree


class Snapshots:
    """Watches trees in training and remembers which hard ones to return.

    Without episodes these are the last ones; with episodes those with the best mean return on them, the trees before
    training included and the earlier of equally good ones: a refinement can then only gain on these episodes.

    The episodes are the same for all trees and all trainings: what comes of a tree does not depend on those beside it.

    Args:
        backend: Runs the trees.
        ddt: The trees that will be trained.
        n_episodes: Number of episodes, E.
        purpose: What the backend counts the steps under.
    """

    def __init__(self, backend: Backend, ddt: SoftSplits, n_episodes: int, purpose: str) -> None:
        self._backend = backend
        self._ddt = ddt
        self._purpose = purpose
        self._seeds = episode_seeds("training", n_episodes, stream(0, "snapshots"))
        numbers = hard_numbers(ddt)
        # A softened leaf may prefer another action than its tree: those before training are the trees themselves.
        self._forest = HardForest(ddt.trees, numbers)
        self._numbers = self._forest.numbers
        self._best = self._returns(self._numbers)

    def look(self) -> None:
        """Compare the trees as they are with the best ones so far."""
        numbers = hard_numbers(self._ddt)
        returns = self._returns(numbers)
        # Equal without episodes: then the last one counts.
        is_better = returns > self._best if len(self._seeds) > 0 else are_finite(numbers)
        self._best = np.where(is_better, returns, self._best)
        self._numbers = chosen(is_better, numbers, self._numbers)

    def trees(self) -> list[DecisionTree]:
        """Return the trees that were found best, [R]."""
        return self._forest.with_numbers(self._numbers).trees()

    def _returns(self, numbers: HardNumbers) -> NDArray[np.float64]:
        """Return the mean return of each tree, [R]; minus infinity where a number is not finite."""
        is_valid = are_finite(numbers)
        if len(self._seeds) == 0:
            return np.where(is_valid, 0.0, -np.inf)
        forest = self._forest.with_numbers(chosen(is_valid, numbers, self._numbers))
        outcomes = self._backend.evaluate(forest, self._seeds, self._purpose)
        return np.where(is_valid, outcomes.returns.mean(1), -np.inf)
