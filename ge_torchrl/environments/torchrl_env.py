"""The TorchRL view of an environment, for everything that learns by gradient.

The only module of this floor that imports torch; nothing of a GE-only run imports it.
"""

from __future__ import annotations

import torch
from torchrl.envs import EnvBase, GymEnv, StepCounter, TransformedEnv

from ge_torchrl.environments.spec import EnvironmentSpec


def make_torchrl_env(spec: EnvironmentSpec, device: torch.device | str = "cpu") -> EnvBase:
    """Wrap an environment as TorchRL's `GymEnv`, with integer actions and a step counter.

    Observations stand under `observation` [D] float32, actions under `action` [] int64, the number of steps since
    the reset under `step_count` [1]; `terminated` and `truncated` are told apart as Gymnasium does.

    Args:
        spec: The environment; its episode limit is kept.
        device: Where tensors live.
    """
    limit = {"max_episode_steps": spec.max_episode_steps} if spec.has_limit else {}
    environment = GymEnv(spec.id, categorical_action_encoding=True, device=device, **limit)
    return TransformedEnv(environment, StepCounter(None if spec.has_limit else spec.max_episode_steps))
