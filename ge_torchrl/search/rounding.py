"""The end of a search with sums: the best kept trees become easier to read, at the same return."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import LimitReachedError, within
from ge_torchrl.refiners.local_search import spread_of
from ge_torchrl.refiners.rounding import Rounding
from ge_torchrl.search.archive import Contender, digest, offer
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.state import SearchState
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

_logger = logging.getLogger(__name__)

ROUNDING = "rounding"
"""The purpose that steps of rounding are counted under."""

# Of what the limit leaves, the part that one tree's rounding may take.
_PART: Final = 0.8
# Steps that show how far features spread under a tree that is rounded.
_OBSERVED: Final = 1000


def round_kept(problem: Problem, state: SearchState) -> SearchState:
    """Round the best kept trees with sums to few terms and few digits; each takes the place of all of its size.

    The best of each size, the fittest first. Of what a limit leaves each may take a large part, so that there is room
    to measure and keep what came of it.
    """
    if not problem.rounds:
        return state
    archive = state.archive
    sizes = sorted({member.tree.num_decision_nodes for member in archive.members})
    best = [archive.of_size(size)[0] for size in sizes]
    # Rounding ends quietly with a limit.
    reached: list[str] = []
    try:
        for member in sorted(best, key=lambda member: -member.archive_fitness):
            tree = rounded(problem, member.tree, reached)
            if tree != member.tree:
                # Validation would choose among kept trees by differences too small to be worth their digits.
                size = member.tree.num_decision_nodes
                others = tuple(other for other in archive.members if other.tree.num_decision_nodes != size)
                contender = Contender(tree, member.train_fitness, member.origin)
                archive = offer(problem, replace(archive, members=others), [contender])
    except LimitReachedError as limit:
        reached.append(limit.reason)
    if archive is not state.archive:
        # The fittest refined tree was offered as well: as it was, it would compete with its own rounded self.
        return replace(state, archive=archive, best_refined=None)
    if reached:
        _logger.warning("ge.%s left no room to round the rules.", reached[0])
    return state


def rounded(problem: Problem, tree: DecisionTree, reached: list[str]) -> DecisionTree:
    """Return a tree with few terms and few digits; as it is where it has no sums, or where trees are not rounded.

    Args:
        problem: What is searched.
        tree: The tree.
        reached: Takes the limit that ended it too early, if one did.

    Raises:
        LimitReachedError: A limit left no room to begin.
    """
    if not problem.rounds or not _has_sums(tree):
        return tree
    seed = problem.config.seed
    seeds = episode_seeds("training", problem.config.starts.rounding_episodes, stream(seed, "rounding"))
    rng = stream(seed, f"rounding of {digest(tree).hex()}")

    def returns(forest: Forest, some: NDArray[np.int64]) -> NDArray[np.float64]:
        try:
            return problem.backend.evaluate(forest, some, ROUNDING).returns
        except LimitReachedError as limit:
            reached.append(limit.reason)
            raise

    (observed,) = problem.backend.observe([tree], _OBSERVED, [rng], ROUNDING)
    spread = spread_of(observed)
    if problem.mirror is not None:
        spread = np.maximum(spread, spread[problem.mirror.feature])
    with within(problem.backend, _PART):
        return Rounding(tree, problem.mirror, spread, seeds, returns).run()


def _has_sums(tree: DecisionTree) -> bool:
    return not tree.is_axis_aligned or len(tree.leaf_feature) > 0
