"""Two sources of samples, one layout: TorchRL's collector for every environment, fused kernels where they exist.

A batch is a TensorDict [T] as the collector gives it, `T` consecutive steps of one stream of episodes:

    observation [T, D] float32, action [T] int64, action_log_prob [T] float32, done / terminated / truncated [T, 1],
    next: observation [T, D], reward / episode_reward [T, 1] float32, done / terminated / truncated [T, 1]

The flags at the root are those before the step, hence False; `episode_reward` sums an episode's rewards so far.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict
from torch import Tensor
from torchrl.collectors import Collector
from torchrl.envs import RewardSum
from torchrl.modules import ProbabilisticActor

from ge_torchrl.environments.choose import agrees_with_gymnasium
from ge_torchrl.environments.dynamics import DYNAMICS
from ge_torchrl.environments.soft_rollouts import SoftSampler
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.environments.torchrl_env import make_torchrl_env
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.rl.actor_critic import ddt_of
from ge_torchrl.seeding import episode_seeds

_FLAGS = ("done", "terminated", "truncated")
_NEXT = ("observation", "reward", "episode_reward", *_FLAGS)
_KEYS = ("observation", "action", "action_log_prob", *_FLAGS, *(("next", key) for key in _NEXT))


class Source(Protocol):
    """Gives samples of an actor, one endless stream of episodes; an episode that a batch cuts goes on in the next."""

    spec: EnvironmentSpec

    def collect(self, actor: ProbabilisticActor, n_frames: int) -> TensorDict:
        """Return the next `n_frames` steps [T] of the actor as it stands."""
        ...

    def close(self) -> None:
        """Release environments."""
        ...


class CollectorSource:
    """Samples through TorchRL's `Collector` over `GymEnv`, a Python step at a time.

    The stream begins anew when `collect` is called with another actor or number of frames. Actions are drawn from a
    torch stream of the source's own, the global one stays as it was.

    Args:
        spec: The environment.
        rng: Seeds the environment and the actions.

    Raises:
        EnvironmentFaultError: The environment's actions do not count from 0, as TorchRL takes for granted.
    """

    def __init__(self, spec: EnvironmentSpec, rng: np.random.Generator) -> None:
        if spec.first_action != 0:
            raise EnvironmentFaultError(
                f"TorchRL counts actions from 0; those of {spec.id} start at {spec.first_action}"
            )
        self.spec = spec
        self._rng = rng
        self._torch_state = torch.Generator().manual_seed(int(rng.integers(2**62))).get_state()
        self._collector: Any = None
        self._collects: tuple[ProbabilisticActor, int] | None = None

    def collect(self, actor: ProbabilisticActor, n_frames: int) -> TensorDict:
        """Return the next samples; see `Source`."""
        with torch.random.fork_rng(devices=[]):
            torch.set_rng_state(self._torch_state)
            if self._collects is None or self._collects[0] is not actor or self._collects[1] != n_frames:
                self._open(actor, n_frames)
            samples: TensorDict = self._collector.next()
            self._torch_state = torch.get_rng_state()
        return samples.select(*_KEYS)

    def _open(self, actor: ProbabilisticActor, n_frames: int) -> None:
        self.close()
        environment = make_torchrl_env(self.spec)
        environment.append_transform(RewardSum())
        environment.set_seed(int(episode_seeds("training", 1, self._rng)[0]))
        self._collector = Collector(
            environment,
            actor,
            frames_per_batch=n_frames,
            total_frames=-1,
            track_traj_ids=False,
            auto_register_policy_transforms=False,
        )
        self._collects = (actor, n_frames)

    def close(self) -> None:
        """Close the environment."""
        if self._collector is not None:
            self._collector.shutdown()
        self._collector, self._collects = None, None


class FusedSource:
    """Samples in a fused kernel, without a Python step; log-probabilities come from one batched forward pass.

    Args:
        spec: An environment of `DYNAMICS`.
        rng: The source of randomness.

    Raises:
        EnvironmentFaultError: The environment has no compiled dynamics.
    """

    def __init__(self, spec: EnvironmentSpec, rng: np.random.Generator) -> None:
        self.spec = spec
        self._sampler = SoftSampler(spec, rng)

    @torch.no_grad()
    def collect(self, actor: ProbabilisticActor, n_frames: int) -> TensorDict:
        """Return the next samples; see `Source`."""
        samples = self._sampler.sample(ddt_of(actor).arrays(), n_frames)
        terminated, truncated = _column(samples.terminated), _column(samples.truncated)
        after = {
            "observation": torch.from_numpy(samples.next_observations),
            "reward": _column(samples.rewards),
            "episode_reward": _column(samples.episode_returns),
            "done": terminated | truncated,
            "terminated": terminated,
            "truncated": truncated,
        }
        before = {key: torch.zeros((n_frames, 1), dtype=torch.bool) for key in _FLAGS}
        batch = TensorDict(
            {
                "observation": torch.from_numpy(samples.observations),
                "action": torch.from_numpy(samples.actions),
                **before,
                "next": TensorDict(after, [n_frames]),
            },
            [n_frames],
        )
        # The actor's own distribution: the ratio of the first gradient step is then exactly one.
        batch["action_log_prob"] = actor.get_dist(batch).log_prob(batch["action"])
        return batch.select(*_KEYS)

    def close(self) -> None:
        """Nothing is held."""


def open_source(spec: EnvironmentSpec, source: str = "auto", *, rng: np.random.Generator) -> Source:
    """Open a source of samples.

    Args:
        spec: The environment.
        source: "fused", "collector", or "auto": fused where compiled dynamics exist and the installed Gymnasium
            agrees with them.
        rng: The source's own stream of randomness.

    Raises:
        EnvironmentFaultError: The environment does not suit the source.
        ValueError: There is no such source.
    """
    if source not in {"auto", "fused", "collector"}:
        raise ValueError(f'source must be "auto", "fused" or "collector", not {source!r}')
    if source == "fused" or (source == "auto" and spec.id in DYNAMICS and agrees_with_gymnasium(spec)):
        return FusedSource(spec, rng)
    return CollectorSource(spec, rng)


def finished_returns(samples: TensorDict) -> NDArray[np.float64]:
    """Return the returns of the episodes that ended in a batch, in their order, `[n]` with `n >= 0`."""
    after = samples["next"]
    returns: NDArray[np.float64] = after["episode_reward"][after["done"]].double().numpy()
    return returns


def _column(values: NDArray[Any]) -> Tensor:
    return torch.from_numpy(values).unsqueeze(-1)
