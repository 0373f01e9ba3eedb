"""Shortening: a tree loses one split after another, each time the one without which it returns most.

A large tree is found more easily than a small one that is as good, and most of its splits bring little. Where the
tree is its own image in a mirror, a split goes with its image. Source: cost-complexity pruning, L. Breiman,
J. Friedman, R. Olshen and C. Stone, "Classification and regression trees" (1984); here it goes by returns.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ge_torchrl.refiners.folding import half_of, whole_of
from ge_torchrl.refiners.local_search import spread_of
from ge_torchrl.refiners.strategy import Strategy
from ge_torchrl.refiners.ties import ties_in
from ge_torchrl.search.problem import Problem
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.nodes import Nodes, forest_of, nodes_of, without_one_split
from ge_torchrl.trees.tree import DecisionTree

# Of all trees without one split those go on that return most in few episodes, and the best one of more is taken.
_FEWEST, _EPISODES, _GO_ON, _MORE_EPISODES = 2, 10, 8, 40
# States that show how far features spread.
_SPREAD_OVER: Final = 1000
# First moves of what is left, in these units; of the steps for a split the strategy has this part.
_FIRST_STEP, _STRATEGY_SHARE = 0.08, 0.4


def shortened(
    problem: Problem,
    tree: DecisionTree,
    n_splits: int,
    timesteps: int,
    purpose: str,
    rng: np.random.Generator,
) -> DecisionTree:
    """Return a tree that has at most so many splits; after each one that goes the thresholds of the others are moved.

    Args:
        problem: What is searched.
        tree: An axis-aligned tree with actions.
        n_splits: How many it may have.
        timesteps: Environment steps, about, that this may take.
        purpose: What the backend counts them under.
        rng: Of all randomness.

    Raises:
        LimitReachedError: The backend's limit was reached first.
    """
    backend, first = problem.backend, problem.backend.steps.total()
    while (too_many := tree.num_decision_nodes - n_splits) > 0:
        left = timesteps - (backend.steps.total() - first)
        share = max(0, left) / too_many * (2 if _half(problem, tree) is not None else 1)
        tree = _without_the_least(problem, tree, share * (1 - _STRATEGY_SHARE), purpose, rng)
        tree = moved(problem, tree, int(share * _STRATEGY_SHARE), _FIRST_STEP, purpose, rng)
    return tree


def strategy_of(
    problem: Problem, tree: DecisionTree, first_step: float, purpose: str, rng: np.random.Generator
) -> Strategy:
    """Return the search for better thresholds of a tree, from those that it has; in a mirror it stays its own image.

    Args:
        problem: What is searched.
        tree: The tree.
        first_step: Standard deviation of the first moves, in units of how far features spread.
        purpose: What the backend counts its steps under.
        rng: Of all its randomness.
    """
    (observed,) = problem.backend.observe([tree], _SPREAD_OVER, [rng], purpose)
    ties = ties_in(tree, problem.mirror)
    units = tree.parameter_units(spread_of(observed))
    return Strategy(problem.backend, tree, ties, units, first_step, purpose, rng)


def moved(
    problem: Problem,
    tree: DecisionTree,
    timesteps: int,
    first_step: float,
    purpose: str,
    rng: np.random.Generator,
) -> DecisionTree:
    """Return a tree with better thresholds, or itself where they are no better on new episodes; args as above."""
    strategy = strategy_of(problem, tree, first_step, purpose, rng)
    strategy.advance(timesteps)
    seeds = episode_seeds("training", _MORE_EPISODES, rng)
    returns = problem.backend.evaluate(Forest.stack([tree, strategy.tree]), seeds, purpose).returns.mean(
        axis=1
    )
    return strategy.tree if returns[1] > returns[0] else tree


def _half(problem: Problem, tree: DecisionTree) -> Nodes | None:
    return None if problem.mirror is None else half_of(tree, problem.mirror)


def _without_the_least(
    problem: Problem, tree: DecisionTree, timesteps: float, purpose: str, rng: np.random.Generator
) -> DecisionTree:
    half, mirror = _half(problem, tree), problem.mirror
    fewer: list[Nodes] = []
    for nodes in without_one_split(nodes_of(tree) if half is None else half):
        whole = nodes if half is None or mirror is None else whole_of(nodes, mirror)
        fewer += [] if whole is None else [whole]
    forest = forest_of(fewer)
    # Without its first fold a half may unfold to a whole that is larger.
    forest = forest.take(np.flatnonzero(forest.num_decision_nodes < tree.num_decision_nodes))
    few = _affordable(timesteps / 2, len(forest), _length(problem, tree, purpose, rng))
    forest = _best(problem, forest, _GO_ON, min(_EPISODES, few), purpose, rng)
    return _best(problem, forest, 1, min(_MORE_EPISODES, 4 * few), purpose, rng).tree(0)


def _affordable(timesteps: float, n_trees: int, length: float) -> int:
    return max(_FEWEST, int(timesteps / (n_trees * length)))


def _length(problem: Problem, tree: DecisionTree, purpose: str, rng: np.random.Generator) -> float:
    """Return about how long the episodes of a tree are."""
    seeds = episode_seeds("training", _FEWEST, rng)
    return float(problem.backend.evaluate(Forest.stack([tree]), seeds, purpose).lengths.mean())


def _best(
    problem: Problem, forest: Forest, n: int, n_episodes: int, purpose: str, rng: np.random.Generator
) -> Forest:
    seeds = episode_seeds("training", n_episodes, rng)
    returns = problem.backend.evaluate(forest, seeds, purpose).returns.mean(axis=1)
    return forest.take(np.argsort(-returns, kind="stable")[:n])
