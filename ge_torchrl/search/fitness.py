"""Fitness: the mean return over a generation's training episodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.route import Route
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.forest import Forest

Fitness = NDArray[np.float64]
# An individual without a tree: below every return that an environment can give.
WORST_FITNESS = -np.inf


@dataclass(frozen=True, eq=False)
class Measurement:
    """Fitness of a forest, and what measuring it took.

    Attributes:
        fitness: [P] float64, mean returns; WORST_FITNESS where there is no tree.
        env_steps: Environment steps taken.
    """

    fitness: Fitness
    env_steps: int


def measure(route: Route, forest: Forest, seeds: NDArray[np.int64]) -> Measurement:
    """Measure the fitness of every tree: the mean of its returns over the episodes `seeds` [E]."""
    outcomes = route.evaluate(forest, seeds)
    fitness = np.where(forest.sizes > 0, outcomes.returns.mean(axis=1), WORST_FITNESS)
    return Measurement(fitness, outcomes.env_steps)


class TrainingEpisodes:
    """The episodes that each generation is measured on.

    Args:
        mode: "fixed": the same in every generation, as the thesis' lineage does; "fresh" or "common": new ones for
            every generation (with "common", parents are measured on them again).
        n_episodes: Episodes a generation, E.
        rng: Stream that draws them.
    """

    def __init__(self, mode: str, n_episodes: int, rng: np.random.Generator) -> None:
        self.remeasures_parents = mode == "common"
        self._fixed = episode_seeds("training", n_episodes, rng) if mode == "fixed" else None
        self._n_episodes = n_episodes
        self._rng = rng

    def next_generation(self) -> NDArray[np.int64]:
        """Return the next generation's episode seeds [E]."""
        if self._fixed is not None:
            return self._fixed
        return episode_seeds("training", self._n_episodes, self._rng)
