"""The TorchRL view of an environment, for everything that learns by gradient.

The only module of this floor that imports torch; nothing of a run without PPO imports it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from torchrl.envs import EnvBase, GymWrapper, RewardSum, TransformedEnv

from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.environments.vector_env import VectorEnvironment


def make_torchrl_env(
    spec: EnvironmentSpec,
    n: int,
    rngs: Sequence[np.random.Generator] | None = None,
    workers: int = 0,
) -> EnvBase:
    """Wrap `n` copies of an environment as one TorchRL environment of batch size [n].

    Under `observation` [n, D] float32 stands what the copies observe, under `action` [n] int64 what they do, counted
    from 0, or [n, A] float32 values, which are cut to their bounds; under `episode_reward` [n, 1] the rewards of an
    episode so far. `terminated` and `truncated` are told apart as Gymnasium does.

    Every episode of every copy begins by a training seed, which the copy's own generator draws: copy `i` sees the same
    episodes in any company. `set_seed(s)` makes new generators, of `s` and `i`.

    Args:
        spec: The environment; its episode limit is kept.
        n: Number of copies.
        rngs: [n] each copy's generator; None makes them as `set_seed(0)` does.
        workers: Number of processes that step the copies; 0 means as many as pay, 1 none but this one.

    Raises:
        EnvironmentFaultError: The environment is at fault; raised by later resets and steps too.
    """
    generators = [np.random.default_rng([0, i]) for i in range(n)] if rngs is None else rngs
    environment = GymWrapper(VectorEnvironment(spec, generators, workers), categorical_action_encoding=True)
    return TransformedEnv(environment, RewardSum())
