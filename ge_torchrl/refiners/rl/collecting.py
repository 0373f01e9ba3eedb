"""Samples of any Gymnasium environment, through TorchRL's collector: a few copies of it for each tree."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor
from torchrl.collectors import Collector

from ge_torchrl.environments.backend import Backend
from ge_torchrl.environments.instances import COPIES
from ge_torchrl.environments.torchrl_env import make_torchrl_env
from ge_torchrl.refiners.rl.actor_critic import SoftTrees, make_actor

# About so many steps are made between two signs of life.
_PIECE_STEPS = 2000
_KEYS = ("observation", "action", "action_log_prob", "next")
_NEXT = ("observation", "reward", "episode_reward", "done", "terminated", "truncated")


class CollectorSource:
    """Samples through TorchRL's `Collector`, a step of all copies of all trees at a time; see `Source`.

    Episodes and actions of a tree follow from its own generator.

    Args:
        backend: The environment, and the ledger of steps.
        ddt: The trees [R].
        rngs: [R] each tree's source of randomness.
        purpose: What the steps are counted under.

    Raises:
        EnvironmentFaultError: The environment is at fault; raised by `collect` too.
    """

    def __init__(
        self, backend: Backend, ddt: SoftTrees, rngs: Sequence[np.random.Generator], purpose: str
    ) -> None:
        self._backend = backend
        self._ddt = ddt
        self._rngs = rngs
        self._purpose = purpose
        self._collector: Any = None

    def collect(self, n_steps: int) -> TensorDict:
        """Return the next samples [R, K, n_steps / K]; every call asks for as many."""
        copies, ledger = math.gcd(COPIES, n_steps), self._backend.ledger
        n_lanes, length = copies * self._ddt.num_trees, n_steps // copies
        piece = _largest_divisor(length, at_most=_PIECE_STEPS // n_lanes)
        if self._collector is None:
            self._open(copies, piece)
        pieces = []
        for _ in range(length // piece):
            ledger.check()
            self._draws.draw(piece)
            pieces.append(self._collector.next().select(*_KEYS))
            ledger.count(self._purpose, n_lanes * piece)
        samples: TensorDict = torch.cat(pieces, 1).reshape(self._ddt.num_trees, copies, length)
        samples["next"] = samples["next"].select(*_NEXT)
        return samples

    def _open(self, copies: int, piece: int) -> None:
        spec = self._backend.spec
        n_values = spec.n_actions if spec.is_continuous else 0
        of_copies = [rng for own in self._rngs for rng in own.spawn(copies)]
        self._draws = Draws([own.spawn(1)[0] for own in self._rngs], copies, n_values)
        environment = make_torchrl_env(spec, len(of_copies), of_copies, self._backend.workers)
        self._backend.sampling_processes = max(self._backend.sampling_processes, environment.processes)
        self._collector = Collector(
            environment,
            make_actor(self._ddt, self._draws),
            frames_per_batch=piece * len(of_copies),
            total_frames=-1,
            track_traj_ids=False,
            auto_register_policy_transforms=False,
        )

    def close(self) -> None:
        """Close the environment."""
        if self._collector is not None:
            self._collector.shutdown()
            self._collector = None


class Draws:
    """Numbers that decide actions, of each tree from its own generator.

    Args:
        rngs: [R] the generators.
        copies: Actions of a tree in one step, K.
        n_values: Number of values of an action, A; 0 where actions are choices.
    """

    def __init__(self, rngs: Sequence[np.random.Generator], copies: int, n_values: int = 0) -> None:
        self._rngs = rngs
        self._copies = copies
        self._n_values = n_values
        # Generators of their own, so that what is drawn does not depend on how many steps are drawn at a time.
        self._rngs_of_values = [rng.spawn(1)[0] for rng in rngs] if n_values > 0 else []
        self._uniform: list[Tensor] = []
        self._normal: list[Tensor] = []

    def draw(self, n_steps: int) -> None:
        """Draw the numbers of the next steps."""
        drawn = np.stack([rng.random((n_steps, self._copies), np.float32) for rng in self._rngs], 1)
        self._uniform += torch.from_numpy(drawn).flatten(1).unbind()
        if self._n_values > 0:
            shape = (n_steps, self._copies, self._n_values)
            drawn = np.stack([rng.standard_normal(shape, np.float32) for rng in self._rngs_of_values], 1)
            self._normal += torch.from_numpy(drawn).flatten(1, 2).unbind()

    def next(self) -> Tensor:
        """Return uniform numbers [R * K] of one step, in [0, 1)."""
        return self._uniform.pop(0)

    def normal(self) -> Tensor:
        """Return standard normal numbers [R * K, A] of one step."""
        return self._normal.pop(0)


def _largest_divisor(number: int, at_most: int) -> int:
    return max(d for d in range(1, max(at_most, 1) + 1) if number % d == 0)
