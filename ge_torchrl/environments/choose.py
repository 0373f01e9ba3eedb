"""The choice of a backend: a kernel where that is the same environment, Gymnasium everywhere."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import Backend
from ge_torchrl.environments.dynamics import DYNAMICS, advance
from ge_torchrl.environments.gymnasium_backend import GymnasiumBackend
from ge_torchrl.environments.kernel_backend import KernelBackend, has_kernel
from ge_torchrl.environments.lanes import (
    ACTION,
    LANE_ROWS,
    LANES,
    OBSERVATION,
    REWARD,
    START_ROWS,
    TERMINATED,
)
from ge_torchrl.environments.spec import EnvironmentSpec, make_gymnasium

_logger = logging.getLogger(__name__)

# Enough steps to meet every term of the equations, few enough to cost milliseconds.
_CHECKED_EPISODES = 4
_CHECKED_STEPS = 24
# A few units in the last place of float32: two honest float64 implementations differ by less.
_TOLERANCE = 1e-5
# Rewards that are no constants are rounded too.
_REWARD_TOLERANCE = 1e-6


def open_backend(spec: EnvironmentSpec, route: str = "auto", threads: int = 0, workers: int = 0) -> Backend:
    """Open the backend that runs trees in an environment.

    `auto` takes the kernel where there is one and the installed Gymnasium agrees with it on a few steps, tried on the
    spot; else Gymnasium itself.

    Args:
        spec: The environment.
        route: "auto", "kernel" or "gymnasium".
        threads: Threads of the kernel, 0 for one a core.
        workers: Processes of Gymnasium, 0 for one a core where that pays.

    Raises:
        EnvironmentFaultError: "kernel" was asked for where there is none.
        ValueError: There is no such route.
    """
    if route not in {"auto", "kernel", "gymnasium"}:
        raise ValueError(f'env.route must be "auto", "kernel" or "gymnasium"; got {route!r}')
    if route == "kernel" or (route == "auto" and has_kernel(spec) and _agrees_or_warns(spec)):
        return KernelBackend(spec, threads)
    return GymnasiumBackend(spec, workers)


def _agrees_or_warns(spec: EnvironmentSpec) -> bool:
    agrees = agrees_with_gymnasium(spec)
    if not agrees:
        _logger.warning(
            "The installed Gymnasium's %s differs from the kernel; running Gymnasium itself.", spec.id
        )
    return agrees


def agrees_with_gymnasium(spec: EnvironmentSpec) -> bool:
    """Tell whether the kernel and the installed Gymnasium give the same first steps of a few episodes."""
    seeds = np.arange(_CHECKED_EPISODES)
    actions = _any_actions(spec, (_CHECKED_STEPS, _CHECKED_EPISODES))
    observations, outcomes = _kernel_steps(spec, seeds, actions)
    environment = make_gymnasium(spec)
    try:
        for episode, seed in enumerate(seeds):
            observation, _ = environment.reset(seed=int(seed))
            for step in range(_CHECKED_STEPS):
                expected = observations[step, :, episode]
                if not np.allclose(observation, expected, atol=_TOLERANCE, rtol=_TOLERANCE):
                    return False
                chosen = actions[step, episode]
                observation, reward, terminated, _, _ = environment.step(
                    chosen if spec.is_continuous else int(chosen)
                )
                expected_reward, expected_end = outcomes[step, :, episode]
                if abs(reward - expected_reward) > _REWARD_TOLERANCE or terminated != expected_end:
                    return False
                if terminated:
                    break
    finally:
        environment.close()
    return True


def _any_actions(spec: EnvironmentSpec, shape: tuple[int, int]) -> NDArray[Any]:
    """Return actions [T, E], or float32 values [T, E, A] of which many lie at the ends."""
    rng = np.random.default_rng(0)
    if not spec.is_continuous:
        return rng.integers(spec.n_actions, size=shape)
    low, high = np.maximum(spec.action_low, -1e3), np.minimum(spec.action_high, 1e3)
    return np.clip(rng.uniform(1.5 * low, 1.5 * high, (*shape, len(low))).astype(np.float32), low, high)


def _kernel_steps(
    spec: EnvironmentSpec, seeds: NDArray[np.int64], actions: NDArray[Any]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the observations [T + 1, D, E] of episodes, and their rewards and whether they terminated, [T, 2, E]."""
    dynamics, n = DYNAMICS[spec.id], len(seeds)
    lanes = np.zeros((LANE_ROWS, LANES))
    lanes[:START_ROWS, :n] = dynamics.starts(seeds).T
    observed = slice(OBSERVATION // LANES, OBSERVATION // LANES + spec.n_features)
    observations, outcomes = [lanes[observed, :n].copy()], []
    for chosen in actions.reshape(len(actions), n, -1):
        lanes[ACTION // LANES : ACTION // LANES + chosen.shape[1], :n] = chosen.T
        advance(dynamics.index, lanes.reshape(-1), n)
        observations.append(lanes[observed, :n].copy())
        outcomes.append(lanes[[REWARD // LANES, TERMINATED // LANES], :n].copy())
    return np.array(observations), np.array(outcomes)
