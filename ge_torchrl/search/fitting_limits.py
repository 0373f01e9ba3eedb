"""As many trees on as many episodes as a limit leaves room for."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import LimitReachedError, Outcomes
from ge_torchrl.search.problem import Problem
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

# Episodes that are measured in any case.
_EPISODES_AT_ONCE = 1


def evaluate_what_fits(
    problem: Problem,
    trees: Sequence[DecisionTree],
    seeds: NDArray[np.int64],
    purpose: str,
    *,
    visits: bool = False,
    at_least: int = 1,
) -> Outcomes:
    """Run as many of the trees on as many of the episodes as the backend's limit lets them.

    All trees come before many episodes. A few trees are run on an episode as far as the limit's utmost goes.

    Args:
        problem: What is searched.
        trees: The trees, taken from the first on.
        seeds: [E] episode seeds, taken from the first on.
        purpose: Under which the steps are counted.
        visits: Whether visits are counted.
        at_least: Trees that are run in any case.

    Returns:
        Of the first trees on the first episodes: all of both where there is no limit.

    Raises:
        LimitReachedError: There is no room for that.
    """
    backend, limit = problem.backend, problem.backend.limit

    def evaluate(first: int, end: int, few: NDArray[np.int64]) -> Outcomes:
        return backend.evaluate(Forest.stack(trees[first:end]), few, purpose, visits=visits)

    if limit is None:
        return evaluate(0, len(trees), seeds)
    done, n_trees = _EPISODES_AT_ONCE, at_least
    backend.limit = limit.utmost
    try:
        outcomes = evaluate(0, n_trees, seeds[:done])
    finally:
        backend.limit = limit
    with suppress(LimitReachedError):
        while n_trees < len(trees):
            more = evaluate(n_trees, 2 * n_trees, seeds[:done])
            outcomes, n_trees = _joined(outcomes, more, axis=0), min(2 * n_trees, len(trees))
        while done < len(seeds):
            more = evaluate(0, n_trees, seeds[done : 2 * done])
            outcomes, done = _joined(outcomes, more, axis=1), 2 * done
    return outcomes


def _joined(one: Outcomes, two: Outcomes, axis: int) -> Outcomes:
    """Return outcomes of more trees (axis 0) or of more episodes (axis 1)."""
    visits = None
    if one.leaf_visits is not None and two.leaf_visits is not None:
        both = one.leaf_visits, two.leaf_visits
        visits = np.concatenate(both) if axis == 0 else both[0] + both[1]
    return Outcomes(
        returns=np.concatenate([one.returns, two.returns], axis),
        lengths=np.concatenate([one.lengths, two.lengths], axis),
        leaf_visits=visits,
    )
