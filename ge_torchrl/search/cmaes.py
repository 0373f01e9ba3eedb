"""Refinement without gradients: the rival of PPO, by the same budget and with the same record.

Leaves first, one at a time, since no threshold helps a leaf that errs; then thresholds, one at a time by steps of all
lengths, and together by CMA-ES (Hansen, "The CMA evolution strategy: a tutorial", 2016), in units of how far their
features spread. Every tree of a refinement is measured on the same episodes.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import cma
import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.route import Route
from ge_torchrl.records import TrainingRecord
from ge_torchrl.refiner_section import CMAESConfig
from ge_torchrl.search.fitness import measure
from ge_torchrl.search.refinement import FIRST, Effort, Tuned
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest

# Steps that show how far features spread; enough for a few episodes, and a small part of any budget.
_PROBE_STEPS = 500
# Length of the shortest move of a single threshold, in units of its feature's spread; the longest is 1.
_SHORTEST_MOVE = 0.01
# Moves that are measured on all episodes after screening.
_PROMISING = 3


class CMAESRefiner:
    """Refines trees of one run.

    Args:
        route: Measures trees.
        config: The budget, in environment steps or seconds, and the episodes.
    """

    def __init__(self, route: Route, config: CMAESConfig) -> None:
        self._route = route
        self._config = config

    def tune(
        self,
        trees: Sequence[DecisionTree],
        rngs: Sequence[np.random.Generator],
        effort: Effort = FIRST,
    ) -> list[Tuned]:
        """Tune trees side by side, all on the same episodes, which the first stream draws; see `RefinesTrees`."""
        if not trees:
            return []
        seeds = episode_seeds("training", effort.factor * self._config.episodes, rngs[0])
        jobs = [partial(self._tune, tree, seeds, rng, effort) for tree, rng in zip(trees, rngs, strict=True)]
        return [jobs[0](self._route)] if len(jobs) == 1 else self._route.run_jobs(jobs)

    def _tune(
        self,
        tree: DecisionTree,
        seeds: NDArray[np.int64],
        rng: np.random.Generator,
        effort: Effort,
        route: Route,
    ) -> Tuned:
        """Tune a tree's leaves and thresholds with its structure unchanged."""
        trial = _Trial(route, tree, self._config, effort, seeds)
        trial.tune_leaves()
        trial.tune_each_threshold(rng)
        trial.tune_thresholds(rng)
        training = TrainingRecord(timesteps=trial.env_steps, updates=trial.rounds)
        return Tuned(trial.best, training, trial.env_steps)


class _Trial:
    """The best tree so far, and how much of the budget is left."""

    def __init__(
        self, route: Route, tree: DecisionTree, config: CMAESConfig, effort: Effort, seeds: NDArray[np.int64]
    ) -> None:
        self._route = route
        factor = effort.factor * effort.patience
        self._first_step = effort.step * config.first_step
        self._moves = config.moves
        self._max_timesteps = factor * config.max_timesteps
        self._deadline = (
            math.inf if config.max_seconds is None else time.perf_counter() + factor * config.max_seconds
        )
        self._seeds = seeds
        self._screening_seeds = seeds[: effort.factor * config.screening_episodes]
        self._spread: NDArray[np.float64] | None = None
        self.best, self.fitness = tree, -math.inf
        self.env_steps = self.rounds = 0
        self._measure([tree])

    def _is_over(self) -> bool:
        if self._deadline < math.inf:
            return time.perf_counter() >= self._deadline
        return self.env_steps >= self._max_timesteps

    def _returns(self, forest: Forest, seeds: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the mean returns [P] of some trees."""
        measured = measure(self._route, forest, seeds)
        self.env_steps += measured.env_steps
        self.rounds += 1
        return measured.fitness

    def _measure(self, trees: Sequence[DecisionTree]) -> None:
        """Measure some trees, and remember the best tree of all."""
        returns = self._returns(Forest.stack(trees), self._seeds)
        winner = int(np.argmax(returns))
        if returns[winner] > self.fitness:
            self.best, self.fitness = trees[winner], float(returns[winner])

    def tune_leaves(self) -> None:
        """Give each leaf in turn its best action, the other leaves as they then are."""
        for leaf in np.flatnonzero(self.best.is_leaf):
            if self._is_over():
                return
            self._measure(list(_with_other_actions(self.best, int(leaf), self._route.spec.n_actions)))

    def tune_each_threshold(self, rng: np.random.Generator) -> None:
        """Move one threshold after the other until no move makes the tree better or the budget is spent."""
        decisions = np.flatnonzero(~self.best.is_leaf)
        if self._moves == 0 or len(decisions) == 0 or self._is_over():
            return
        spread, before = self._spread_of_features(rng), -math.inf
        while self.fitness > before:
            before = self.fitness
            for node in rng.permutation(decisions):
                if self._is_over():
                    return
                self._measure(self._promising_moves(int(node), spread, rng))

    def _promising_moves(
        self, node: int, spread: NDArray[np.float64], rng: np.random.Generator
    ) -> list[DecisionTree]:
        """Return the best tree so far with one threshold moved, in those ways that screening finds best."""
        tree = self.best
        lengths = _SHORTEST_MOVE ** rng.random(self._moves)
        signs = np.where(np.arange(self._moves) % 2 == 0, -1.0, 1.0)
        thresholds = np.tile(tree.threshold, (self._moves, 1))
        thresholds[:, node] = tree.threshold[node] + signs * lengths * spread[tree.feature[node]]
        chosen = np.arange(self._moves)
        if 0 < len(self._screening_seeds) < len(self._seeds) and self._moves > _PROMISING:
            returns = self._returns(Forest.of_thresholds(tree, thresholds), self._screening_seeds)
            chosen = np.argsort(-returns, kind="stable")[:_PROMISING]
        return [replace(tree, threshold=thresholds[i]) for i in chosen]

    def _spread_of_features(self, rng: np.random.Generator) -> NDArray[np.float64]:
        if self._spread is None:
            self._spread = spread_of(self._route.observe(self.best, _PROBE_STEPS, rng))
            self.env_steps += _PROBE_STEPS
        return self._spread

    def tune_thresholds(self, rng: np.random.Generator) -> None:
        """Move all thresholds together by CMA-ES until the budget is spent or it has converged."""
        tree = self.best
        decisions = np.flatnonzero(~tree.is_leaf)
        if len(decisions) == 0 or self._is_over():
            return
        spread = self._spread_of_features(rng)[tree.feature[decisions]]
        # pycma has no one-dimensional form: a lone threshold gets an idle companion.
        strategy = cma.CMAEvolutionStrategy(
            np.zeros(max(len(decisions), 2)),
            self._first_step,
            # Its numbers come from our stream, and numpy's global one stays as it was.
            {
                "seed": np.nan,
                "randn": lambda *shape: rng.standard_normal(shape),
                "verbose": -9,
                "verb_log": 0,
            },
        )
        # A float32 that a wild step would overflow stays a number.
        limit = np.finfo(np.float32).max
        while not self._is_over() and not strategy.stop():
            points = strategy.ask()
            thresholds = np.tile(tree.threshold, (len(points), 1))
            moves = spread * np.array(points)[:, : len(decisions)]
            thresholds[:, decisions] = np.clip(tree.threshold[decisions] + moves, -limit, limit)
            returns = self._returns(Forest.of_thresholds(tree, thresholds), self._seeds)
            strategy.tell(points, (-returns).tolist())
            winner = int(np.argmax(returns))
            if returns[winner] > self.fitness:
                self.best = replace(tree, threshold=thresholds[winner])
                self.fitness = float(returns[winner])


def spread_of(observations: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return [D], the standard deviation of each feature over observations [T, D]; 1 where it tells nothing."""
    spread = observations.astype(np.float64).std(axis=0)
    return np.where(np.isfinite(spread) & (spread > 0), spread, 1.0)


def _with_other_actions(tree: DecisionTree, leaf: int, n_actions: int) -> Iterator[DecisionTree]:
    for action in range(n_actions):
        if action != tree.action[leaf]:
            actions = tree.action.copy()
            actions[leaf] = action
            yield replace(tree, action=actions)
