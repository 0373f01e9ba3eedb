"""Fitness: the mean return over a generation's training episodes, less a penalty on its spread where asked for."""

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
        fitness: [P] float64; WORST_FITNESS where there is no tree.
        env_steps: Environment steps taken.
    """

    fitness: Fitness
    env_steps: int


def measure(route: Route, forest: Forest, seeds: NDArray[np.int64], std_penalty: float = 0.0) -> Measurement:
    """Measure the fitness of every tree on the same episodes.

    With the returns R_1 ... R_E of a tree and the penalty k, its fitness is

        mean(R) - k * std(R),  std(R) = sqrt(sum((R_e - mean(R))^2) / E),

    so that of two trees with equal means the steadier one is fitter. With k = 0 it is the mean return.

    Args:
        route: Runs the trees.
        forest: `P` trees, some of them possibly missing.
        seeds: [E] episode seeds.
        std_penalty: k, at least 0.
    """
    outcomes = route.evaluate(forest, seeds)
    fitness = outcomes.returns.mean(axis=1)
    if std_penalty > 0:
        fitness = fitness - std_penalty * outcomes.returns.std(axis=1)
    return Measurement(np.where(forest.sizes > 0, fitness, WORST_FITNESS), outcomes.env_steps)


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
