"""Which hard trees come back from a training: the best ones on the way."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import Backend
from ge_torchrl.refiners.rl.ddt import DDT, hard_numbers
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.forest import Forest
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

    def __init__(self, backend: Backend, ddt: DDT, n_episodes: int, purpose: str) -> None:
        self._backend = backend
        self._ddt = ddt
        self._purpose = purpose
        self._seeds = episode_seeds("training", n_episodes, stream(0, "snapshots"))
        self._forest = Forest.stack(ddt.trees)
        threshold, action = hard_numbers(ddt)
        self._is_split = _is_own(threshold, [tree.num_decision_nodes for tree in ddt.trees])
        self._is_leaf = _is_own(action, [tree.num_leaves for tree in ddt.trees])
        # A softened leaf may prefer another action than its tree: those before training are the trees themselves.
        action[self._is_leaf] = self._forest.arrays.action
        self._threshold, self._action = threshold, action
        self._best = self._returns(threshold, action)

    def look(self) -> None:
        """Compare the trees as they are with the best ones so far."""
        threshold, action = hard_numbers(self._ddt)
        returns = self._returns(threshold, action)
        # Equal without episodes: then the last one counts.
        is_better = returns > self._best if len(self._seeds) > 0 else np.isfinite(threshold).all(1)
        self._best = np.where(is_better, returns, self._best)
        chosen = np.expand_dims(is_better, 1)
        self._threshold = np.where(chosen, threshold, self._threshold)
        self._action = np.where(chosen, action, self._action)

    def trees(self) -> list[DecisionTree]:
        """Return the trees that were found best, [R]."""
        return self._stacked(self._threshold, self._action).trees()

    def _returns(self, threshold: NDArray[np.float32], action: NDArray[np.int32]) -> NDArray[np.float64]:
        """Return the mean return of each tree, [R]; minus infinity for a threshold that is not finite."""
        is_valid = np.isfinite(threshold).all(1)
        if len(self._seeds) == 0:
            return np.where(is_valid, 0.0, -np.inf)
        forest = self._stacked(np.where(np.expand_dims(is_valid, 1), threshold, self._threshold), action)
        outcomes = self._backend.evaluate(forest, self._seeds, self._purpose)
        return np.where(is_valid, outcomes.returns.mean(1), -np.inf)

    def _stacked(self, threshold: NDArray[np.float32], action: NDArray[np.int32]) -> Forest:
        return Forest(
            self._forest.arrays._replace(threshold=threshold[self._is_split], action=action[self._is_leaf])
        )


def _is_own(padded: NDArray[np.generic], lengths: Sequence[int]) -> NDArray[np.bool_]:
    """Return [R, N], False where a row of that length is padding."""
    own: NDArray[np.bool_] = np.arange(padded.shape[1]) < np.array(lengths)[:, np.newaxis]
    return own
