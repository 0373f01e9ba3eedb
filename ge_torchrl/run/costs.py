"""What the refinement of a tree takes: a cautious guess from the configuration, and the seconds that were seen."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ge_torchrl.config import Config
from ge_torchrl.environments.backend import Backend
from ge_torchrl.environments.instances import COPIES
from ge_torchrl.refiners.protocol import FIRST, Effort, Refined, Refiner
from ge_torchrl.trees.tree import DecisionTree

# PyTorch and TorchRL take so long for a step of a tree in training, beside the environment [s]: in the large batches
# that kernels are refined in, and in the small ones of other environments.
_TRAINING_SECONDS_WITH_KERNELS, _TRAINING_SECONDS = 5e-6, 4e-5
# PPO steps environments in one process, and with more between two steps than plain evaluation.
_SLOWER = 2
# Outside kernels a batch of any size takes so long for each step of its eight copies of the environment [s].
_BATCH_SECONDS = 1.5e-3
# From this speed on an environment has kernels.
_KERNELS = 1e6
# Loading PyTorch takes so long [s].
_LOADING_SECONDS = 5.0
# The part of what is left that a batch may be expected to take.
_PART = 0.8


@dataclass(frozen=True)
class Cost:
    """What something takes.

    Attributes:
        seconds: Clock time [s].
        steps: Environment steps.
    """

    seconds: float
    steps: float

    def __add__(self, other: Cost) -> Cost:
        return Cost(self.seconds + other.seconds, self.steps + other.steps)

    def times(self, n: float) -> Cost:
        """Return what `n` of it take."""
        return Cost(n * self.seconds, n * self.steps)


NOTHING = Cost(0.0, 0.0)


def training_cost(config: Config, max_episode_steps: int) -> Cost:
    """Return what PPO of one tree will take; episodes may be taken to be half as long as they can be.

    Args:
        config: The configuration, its budgets resolved.
        max_episode_steps: The longest episode.
    """
    ppo = config.refiner.ppo
    snapshots = _episodes(
        config, max_episode_steps, ppo.snapshot_episodes * (ppo.max_timesteps // ppo.update_timesteps)
    )
    has_kernels = _steps_per_second(config) >= _KERNELS
    training = _TRAINING_SECONDS_WITH_KERNELS if has_kernels else _TRAINING_SECONDS
    own = _SLOWER / _steps_per_second(config) + training
    return Cost(ppo.max_timesteps * own, ppo.max_timesteps) + snapshots


def batch_cost(config: Config) -> Cost:
    """Return what a batch takes beside its trees, however many they are."""
    if _steps_per_second(config) >= _KERNELS:
        return NOTHING
    return Cost(config.refiner.ppo.max_timesteps / COPIES * _BATCH_SECONDS, 0.0)


def measuring_cost(config: Config, max_episode_steps: int) -> Cost:
    """Return what it will take to accept and to measure a refined tree; see `training_cost`."""
    refiner = config.refiner
    n_episodes = 2 * refiner.acceptance_episodes + 3 * refiner.measuring_episodes + config.evaluation.episodes
    return _episodes(config, max_episode_steps, n_episodes)


def refinement_cost(config: Config, max_episode_steps: int) -> Cost:
    """Return what PPO of all proposals of a generation will take; see `training_cost`."""
    if config.refiner.method != "ppo":
        return NOTHING
    n_first = config.refiner.candidates + config.archive.neighbours
    n_again = config.archive.revisit_factor
    training, measuring = (
        training_cost(config, max_episode_steps),
        measuring_cost(config, max_episode_steps),
    )
    batches = batch_cost(config).times(1 + n_again)
    return batches + training.times(n_first + n_again) + measuring.times(n_first + (n_again > 0))


def _episodes(config: Config, max_episode_steps: int, n: int) -> Cost:
    steps = n * max_episode_steps / 2
    return Cost(steps / _steps_per_second(config), steps)


def _steps_per_second(config: Config) -> float:
    return config.evaluation.steps_per_second or math.inf


class Rationed:
    """A refiner that begins no more trees than a limit leaves room for; the others come back as they were.

    Of a generation that a limit breaks off nothing is kept: what was refined in it would be lost. The seconds of a
    tree are guessed at first, and then those that a tree of the last batch took. Its steps are always the guess: with
    a limit of steps alone a run is a function of its state, whatever was refined before.

    Args:
        refiner: Refines those that are begun.
        backend: Whose limit holds.
        config: The configuration, its budgets resolved.
    """

    def __init__(self, refiner: Refiner, backend: Backend, config: Config) -> None:
        self._refiner, self._backend = refiner, backend
        longest = backend.spec.max_episode_steps
        self._training, self._measuring = training_cost(config, longest), measuring_cost(config, longest)
        self._batch = batch_cost(config)
        self._loading = _LOADING_SECONDS

    def refine(
        self,
        trees: Sequence[DecisionTree],
        rngs: Sequence[np.random.Generator],
        effort: Effort = FIRST,
    ) -> list[Refined]:
        """Refine the first trees, as many as there is room for; see `Refiner`."""
        times = effort.factor * effort.patience
        n = self._begun(len(trees), times)
        left_out = [Refined(tree, None) for tree in trees[n:]]
        if n == 0:
            return left_out
        started = time.perf_counter()
        refined = self._refiner.refine(trees[:n], rngs[:n], effort)
        seconds = (time.perf_counter() - started) / (n * times)
        # A share of the batch is in it; for fewer trees that is too little, so the batch stays on top.
        self._training, self._loading = Cost(seconds, self._training.steps), 0.0
        return [*refined, *left_out]

    def _begun(self, n: int, times: float) -> int:
        limit, cost = self._backend.limit, self._training.times(times) + self._measuring
        if limit is None:
            return n
        seconds = limit.deadline - time.perf_counter() - self._loading - times * self._batch.seconds
        room = min(seconds / cost.seconds, self._backend.ledger.steps_left / cost.steps)
        return int(max(0, min(n, _PART * room)))
