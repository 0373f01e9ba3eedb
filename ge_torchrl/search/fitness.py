"""Fitness: the mean return over episodes, less a penalty on its spread; and which episodes measure it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.config import Config
from ge_torchrl.environments.backend import Backend
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.forest import Forest

Fitness = NDArray[np.float64]
Seeds = NDArray[np.int64]
# An individual without a tree: below every return that an environment can give.
WORST_FITNESS = -np.inf


def fitness_of(returns: NDArray[np.float64], std_penalty: float) -> Fitness:
    """Return `mean(R) - k std(R)` of each tree, with `std(R) = sqrt(sum((R_e - mean(R))^2) / E)`.

    Of two trees with equal means the steadier one is fitter. With k = 0 it is the mean return. Everything that is
    compared in a search is compared on this one scale.

    Args:
        returns: [P, E] float64, NaN for an individual without a tree.
        std_penalty: k, at least 0.

    Returns:
        [P] float64; WORST_FITNESS where there is no tree.
    """
    fitness: Fitness = returns.mean(axis=1)
    if std_penalty > 0:
        fitness = fitness - std_penalty * returns.std(axis=1)
    return np.where(np.isnan(fitness), WORST_FITNESS, fitness)


def measure(
    backend: Backend, forest: Forest, seeds: Seeds, purpose: str, std_penalty: float = 0.0
) -> Fitness:
    """Return the fitness [P] of every tree on the same episodes; see `fitness_of`.

    Args:
        backend: Runs the trees.
        forest: `P` trees, some of them possibly missing.
        seeds: [E] episode seeds.
        purpose: Under which the steps are counted.
        std_penalty: k, at least 0.
    """
    return fitness_of(backend.evaluate(forest, seeds, purpose).returns, std_penalty)


def training_seeds(config: Config, generation: int) -> Seeds:
    """Return the episodes [E] that a generation is measured on.

    With `evaluation.episode_seeds=fixed` they are the same in every generation, as in the thesis' lineage.
    """
    name = "training episodes"
    if config.evaluation.episode_seeds != "fixed":
        name = f"{name}, generation {generation}"
    return episode_seeds("training", config.evaluation.episodes, stream(config.seed, name))


def archive_seeds(config: Config) -> Seeds:
    """Return the episodes that measure what is offered to the archive, used for nothing else."""
    # Of the same purpose as validation, so that neither training nor the test shares an episode with them.
    return episode_seeds("validation", config.archive.episodes, stream(config.seed, "archive episodes"))


def validation_seeds(config: Config) -> Seeds:
    """Return the episodes that choose and prune the champion."""
    rng = stream(config.seed, "validation episodes")
    return episode_seeds("validation", config.evaluation.validation_episodes, rng)


def test_seeds(config: Config) -> Seeds:
    """Return the unseen episodes of the final test."""
    return episode_seeds("test", config.evaluation.test_episodes, stream(config.seed, "test episodes"))
