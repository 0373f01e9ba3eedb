"""Two sources of samples, one layout: fused kernels where they exist, TorchRL's collector everywhere else.

A batch is a TensorDict [R, T] of `T` consecutive steps of one stream of episodes a tree, or [R, K, T] of K streams:

    observation [..., D], action int64 (or [..., A] float32, values as drawn), action_log_prob float32,
    next: observation [..., D], reward / episode_reward [..., 1] float32, done / terminated / truncated [..., 1] bool

`episode_reward` sums an episode's rewards so far.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict
from torch import Tensor
from torchrl.modules import ProbabilisticActor

from ge_torchrl.environments.backend import Backend, Sampler
from ge_torchrl.refiners.rl.actor_critic import SoftTrees


class Source(Protocol):
    """Gives samples of soft trees, endless streams of episodes; an episode that a batch cuts goes on in the next."""

    def collect(self, n_steps: int) -> TensorDict:
        """Return the next `n_steps` steps of each tree as it stands."""
        ...

    def close(self) -> None:
        """Release environments."""
        ...


class KernelSource:
    """Samples in fused kernels, without a Python step; log-probabilities come from one batched forward pass.

    Args:
        sampler: The streams [R].
        ddt: The trees [R].
        actor: The actor around them.
        purpose: What the backend counts the steps under.
    """

    def __init__(self, sampler: Sampler, ddt: SoftTrees, actor: ProbabilisticActor, purpose: str) -> None:
        self._sampler = sampler
        self._ddt = ddt
        self._actor = actor
        self._purpose = purpose

    @torch.no_grad()
    def collect(self, n_steps: int) -> TensorDict:
        """Return the next samples [R, T]; see `Source`."""
        samples = self._sampler.sample(self._ddt.soft_forest(), n_steps, self._purpose)
        terminated, truncated = _column(samples.terminated), _column(samples.truncated)
        shape = samples.rewards.shape
        after = {
            "observation": torch.from_numpy(samples.next_observations),
            "reward": _column(samples.rewards),
            "episode_reward": _column(samples.episode_returns),
            "done": terminated | truncated,
            "terminated": terminated,
            "truncated": truncated,
        }
        batch = TensorDict(
            {
                "observation": torch.from_numpy(samples.observations),
                "action": torch.from_numpy(samples.actions),
                "next": TensorDict(after, shape),
            },
            shape,
        )
        # The actor's own distribution: the ratio of the first gradient step is then exactly one.
        batch["action_log_prob"] = self._actor.get_dist(batch.select("observation")).log_prob(batch["action"])
        return batch

    def close(self) -> None:
        """Nothing is held."""


def open_source(
    backend: Backend,
    ddt: SoftTrees,
    actor: ProbabilisticActor,
    rngs: Sequence[np.random.Generator],
    purpose: str,
) -> Source:
    """Open a source of samples: kernels where the backend has them, else TorchRL's collector.

    Args:
        backend: The environment.
        ddt: The trees [R].
        actor: The actor around them.
        rngs: [R] the source of randomness of each tree.
        purpose: What the backend counts the steps under.
    """
    sampler = backend.sampler(rngs)
    if sampler is None:
        from ge_torchrl.refiners.rl.collecting import CollectorSource

        return CollectorSource(backend, ddt, rngs, purpose)
    return KernelSource(sampler, ddt, actor, purpose)


def last_returns(samples: TensorDict) -> NDArray[np.float64]:
    """Return [R], the mean return of the episodes that ended in a batch; NaN where none did."""
    ended = samples["next", "done"].flatten(1).double()
    returns = samples["next", "episode_reward"].flatten(1).double()
    # Where nothing ended, 0 / 0 is the NaN that is wanted.
    mean: NDArray[np.float64] = (torch.where(ended > 0, returns, 0.0).sum(1) / ended.sum(1)).numpy()
    return mean


def _column(values: NDArray[Any]) -> Tensor:
    return torch.from_numpy(values).unsqueeze(-1)
