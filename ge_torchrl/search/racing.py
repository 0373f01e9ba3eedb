"""A race: trees run against one other tree on common episodes, in growing rounds, until one of them is clearly better.

Where steps are dear, no tree gets more episodes than it takes to tell. What is worse after a few episodes drops out;
what is better by enough standard errors of the paired differences has won. Returns have heavy tails, a failed landing
costs what ten better ones bring, so few episodes decide against a tree but never for one. Source: O. Maron and
A. Moore, "Hoeffding races", NIPS 1993; the share that goes on is that of successive halving (Jamieson and Talwalkar,
"Non-stochastic best arm identification", AISTATS 2016).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.search.fitness import fitness_of
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.refinement import CLEARLY
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

RACES: Final = "races"
"""The purpose that steps of races are counted under."""

# Episodes of each round, the least that a tree can win on, and the part of the trees that goes on at most.
_ROUNDS: Final = (5, 5, 10, 20, 40, 80)
_LEAST_EPISODES: Final = 10
_GO_ON: Final = 0.3
# What a decision node has to bring, in standard deviations of the parent's returns: on LunarLander 0.2 of return. Of
# trees that do the same the smaller one wins at once.
_NODE_BRINGS: Final = 0.002


@dataclass(frozen=True, eq=False)
class Raced:
    """What came of a race.

    Attributes:
        winner: The tree that is clearly better than its parent; None where none is.
        parent_returns: [E] returns of the parent, on as many new episodes as the race took.
        winner_returns: [E] those of the winner on the same ones; empty where there is none.
    """

    winner: DecisionTree | None
    parent_returns: NDArray[np.float64]
    winner_returns: NDArray[np.float64]


def race(
    problem: Problem, parent: DecisionTree, trees: Sequence[DecisionTree], rng: np.random.Generator
) -> Raced:
    """Race trees against their parent.

    Args:
        problem: What is searched.
        parent: The tree to be beaten.
        trees: Who tries.
        rng: Draws the episodes.

    Raises:
        LimitReachedError: The backend's limit was reached first.
    """
    none = np.zeros((0,))
    returns, lanes = np.zeros((1 + len(trees), 0)), np.arange(len(trees))
    fewer_nodes = np.array([parent.num_decision_nodes - tree.num_decision_nodes for tree in trees])
    for n_episodes in _ROUNDS:
        if len(lanes) == 0:
            break
        seeds = episode_seeds("training", n_episodes, rng)
        forest = Forest.stack([parent, *(trees[lane] for lane in lanes.tolist())])
        more = problem.backend.evaluate(forest, seeds, RACES).returns
        returns = np.concatenate([returns, more], axis=1)
        charge = _NODE_BRINGS * float(returns[0].std()) * fewer_nodes[lanes]
        gained = returns[1:] - returns[0] + charge[:, np.newaxis]
        errors = standard_errors(gained)
        won = errors > CLEARLY if returns.shape[1] >= _LEAST_EPISODES else np.zeros(len(lanes), np.bool_)
        won &= _are_fitter(problem, returns, fewer_nodes[lanes])
        if won.any():
            first = int(np.argmax(np.where(won, gained.mean(axis=1), -np.inf)))
            return Raced(trees[int(lanes[first])], returns[0], returns[1 + first])
        ahead = np.flatnonzero(errors > 0)
        most = max(1, int(_GO_ON * len(lanes)))
        kept = ahead[np.argsort(-errors[ahead], kind="stable")[:most]]
        lanes, returns = lanes[kept], returns[np.append(0, 1 + kept)]
    return Raced(None, returns[0], none)


def standard_errors(gained: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return [P], how many standard errors paired differences [P, E] lie above 0 on average."""
    mean, error = gained.mean(axis=1), gained.std(axis=1) / math.sqrt(gained.shape[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        # Trees that do the same differ by the price of their nodes, without any error.
        errors: NDArray[np.float64] = np.where(mean == 0, 0.0, mean / error)
    return errors


def _are_fitter(
    problem: Problem, returns: NDArray[np.float64], fewer_nodes: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Tell which trees are fitter than the parent in the first row, where fitness is less than the mean return."""
    penalty = problem.config.evaluation.std_penalty
    if penalty == 0:
        return np.ones(len(returns) - 1, np.bool_)
    fitness = fitness_of(returns, penalty)
    fitter: NDArray[np.bool_] = (fitness[1:] > fitness[0]) | ((fitness[1:] == fitness[0]) & (fewer_nodes > 0))
    return fitter
