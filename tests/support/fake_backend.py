"""An analytic environment: what a tree returns is a function of its numbers and its actions, plus an episode's luck."""

from __future__ import annotations

from collections import Counter
from types import SimpleNamespace

import numpy as np

from ge_torchrl.environments.backend import Limit, LimitReachedError, Outcomes


class FakeBackend:
    """Stands in for a backend, and notes what it is asked.

    Args:
        value: Gives the return of a tree, but for the episode's luck, which all trees share.
        n_actions: Number of actions.
        spread: [D] standard deviations of what trees see.
        steps: Environment steps of each episode.
        luck: Standard deviation of the episodes' luck.

    Attributes:
        batches: Number of trees and of episodes of each evaluation.
        episodes: The seeds of each evaluation.
    """

    name = "fake"
    steps_per_second = 1e6

    def __init__(self, value, n_actions=2, spread=(1.0, 1.0), steps=10, luck=0.1):
        self.spec = SimpleNamespace(
            names=SimpleNamespace(action_spread=np.ones(n_actions)),
            n_actions=n_actions,
            n_features=len(spread),
        )
        self.steps = Counter()
        self.limit: Limit | None = None
        self.batches, self.episodes = [], []
        self._value, self._spread, self._steps, self._luck = value, np.array(spread), steps, luck

    def evaluate(self, forest, seeds, purpose, *, visits=False):
        assert not visits
        self.batches.append((len(forest), len(seeds)))
        self.episodes.append(tuple(seeds.tolist()))
        values = np.array([self._value(tree) for tree in forest.trees()])
        luck = np.array([np.random.default_rng(seed).normal() for seed in seeds])
        lengths = np.full((len(forest), len(seeds)), self._steps, np.int64)
        self._count(purpose, int(lengths.sum()))
        return Outcomes(values[:, np.newaxis] + self._luck * luck, lengths)

    def observe(self, trees, n_steps, rngs, purpose):
        self._count(purpose, len(trees) * n_steps)
        shape = (n_steps, len(self._spread))
        return np.stack([rng.normal(size=shape) * self._spread for rng in rngs]).astype(np.float32)

    def run_jobs(self, jobs):
        return [job(self) for job in jobs]

    def _count(self, purpose, n_steps):
        self.steps[purpose] += n_steps
        if (
            self.limit
            and self.limit.max_env_steps is not None
            and self.steps.total() >= self.limit.max_env_steps
        ):
            raise LimitReachedError("max_env_steps")
