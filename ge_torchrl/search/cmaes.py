"""Refinement without gradients: the fair rival of PPO, by the same budget and with the same record.

Leaves first, one at a time, since no threshold helps a leaf that errs; then thresholds by CMA-ES (Hansen, "The CMA
evolution strategy: a tutorial", 2016) in units of how far their features spread. Every tree of a refinement is
measured on the same episodes.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import cma
import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.route import Route
from ge_torchrl.environments.spec import EnvironmentSpec, make_gymnasium
from ge_torchrl.refinement_section import PPOConfig
from ge_torchrl.rl.ppo import TrainingRecord
from ge_torchrl.search.fitness import measure
from ge_torchrl.search.refinement import Refinement, compare, stream_name
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest

# Of a feature's spread: about where a grammar's threshold and its best neighbour lie.
_FIRST_STEP = 0.3
_PROBE_STEPS = 1000


class CMAESRefiner:
    """Refines trees of one run.

    Args:
        route: Measures trees.
        config: The budget, in environment steps or seconds, and the episodes.
        seed: The run's seed, from which all randomness follows.
    """

    def __init__(self, route: Route, config: PPOConfig, seed: int) -> None:
        self._route = route
        self._config = config
        self._seed = seed

    def refine(self, tree: DecisionTree, generation: int, attempt: int = 0) -> Refinement:
        """Tune a tree's leaves and thresholds with its structure unchanged, and measure it anew.

        Args:
            tree: The tree.
            generation: Names the stream of randomness, so that one refinement does not depend on another.
            attempt: Counts the refinements of a generation; names the stream too.
        """
        started = time.perf_counter()
        rng = stream(self._seed, f"refinement in {stream_name(generation, attempt)}")
        trial = _Trial(self._route, tree, self._config, rng)
        trial.tune_leaves()
        trial.tune_thresholds(rng)
        seeds = episode_seeds("training", self._config.measuring_episodes, rng)
        training = TrainingRecord(timesteps=trial.env_steps, updates=trial.rounds)
        return compare(self._route, tree, trial.best, seeds, training, trial.env_steps, started)


class _Trial:
    """The best tree so far, and how much of the budget is left."""

    def __init__(self, route: Route, tree: DecisionTree, config: PPOConfig, rng: np.random.Generator) -> None:
        self._route = route
        self._config = config
        self._deadline = (
            math.inf if config.cmaes_seconds is None else time.perf_counter() + config.cmaes_seconds
        )
        self._seeds = episode_seeds("training", config.cmaes_episodes, rng)
        self._probe_seed = int(episode_seeds("training", 1, rng)[0])
        self.best, self.fitness = tree, -math.inf
        self.env_steps = self.rounds = 0
        self._measure([tree])

    @property
    def _is_over(self) -> bool:
        if self._config.cmaes_seconds is not None:
            return time.perf_counter() >= self._deadline
        return self.env_steps >= self._config.max_timesteps

    def _measure(self, trees: Sequence[DecisionTree]) -> NDArray[np.float64]:
        """Return the mean returns [P] of some trees, and remember the best tree."""
        measured = measure(self._route, Forest.stack(trees), self._seeds)
        self.env_steps += measured.env_steps
        self.rounds += 1
        winner = int(np.argmax(measured.fitness))
        if measured.fitness[winner] > self.fitness:
            self.best, self.fitness = trees[winner], float(measured.fitness[winner])
        return measured.fitness

    def tune_leaves(self) -> None:
        """Give each leaf in turn its best action, the other leaves as they then are."""
        for leaf in np.flatnonzero(self.best.is_leaf):
            if self._is_over:
                return
            self._measure(list(_with_other_actions(self.best, int(leaf), self._route.spec.n_actions)))

    def tune_thresholds(self, rng: np.random.Generator) -> None:
        """Move all thresholds together by CMA-ES until the budget is spent or it has converged."""
        tree = self.best
        decisions = np.flatnonzero(~tree.is_leaf)
        if len(decisions) == 0 or self._is_over:
            return
        spread = visited_spread(self._route.spec, tree, self._probe_seed)[tree.feature[decisions]]
        self.env_steps += _PROBE_STEPS
        # pycma has no one-dimensional form: a lone threshold gets an idle companion.
        strategy = cma.CMAEvolutionStrategy(
            np.zeros(max(len(decisions), 2)),
            _FIRST_STEP,
            # Its numbers come from our stream, and numpy's global one stays as it was.
            {
                "seed": np.nan,
                "randn": lambda *shape: rng.standard_normal(shape),
                "verbose": -9,
                "verb_log": 0,
            },
        )
        while not self._is_over and not strategy.stop():
            points = strategy.ask()
            trees = [
                _with_thresholds(
                    tree, decisions, tree.threshold[decisions] + spread * point[: len(decisions)]
                )
                for point in points
            ]
            strategy.tell(points, (-self._measure(trees)).tolist())


def visited_spread(spec: EnvironmentSpec, tree: DecisionTree, seed: int) -> NDArray[np.float64]:
    """Return [D], the standard deviation of each feature over 1,000 steps that a tree takes; 1 where it is 0."""
    env = make_gymnasium(spec.id, spec.max_episode_steps)
    try:
        observation, _ = env.reset(seed=seed)
        visited = []
        for _ in range(_PROBE_STEPS):
            visited.append(np.asarray(observation, np.float64))
            action = int(tree.decide(np.asarray(observation, np.float32)[None])[0])
            observation, _, terminated, truncated, _ = env.step(action + spec.first_action)
            if terminated or truncated:
                observation, _ = env.reset()
    finally:
        env.close()
    spread = np.std(visited, axis=0)
    return np.where(np.isfinite(spread) & (spread > 0), spread, 1.0)


def _with_other_actions(tree: DecisionTree, leaf: int, n_actions: int) -> Iterator[DecisionTree]:
    for action in range(n_actions):
        if action != tree.action[leaf]:
            actions = tree.action.copy()
            actions[leaf] = action
            yield replace(tree, action=actions)


def _with_thresholds(
    tree: DecisionTree, decisions: NDArray[np.int64], values: NDArray[np.float64]
) -> DecisionTree:
    threshold = tree.threshold.copy()
    # A float32 that a wild step would overflow stays a number.
    limit = np.finfo(np.float32).max
    threshold[decisions] = np.clip(values, -limit, limit)
    return replace(tree, threshold=threshold)
