"""The choice of a backend: a kernel where that is the same environment, Gymnasium everywhere."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import Backend
from ge_torchrl.environments.dynamics import (
    ACTION,
    DYNAMICS,
    LANE_ROWS,
    LANES,
    OBSERVATION,
    REWARD,
    START_ROWS,
    TERMINATED,
    advance,
)
from ge_torchrl.environments.gymnasium_backend import GymnasiumBackend
from ge_torchrl.environments.kernel_backend import KernelBackend, has_kernel
from ge_torchrl.environments.spec import EnvironmentSpec, make_gymnasium

_logger = logging.getLogger(__name__)

# Enough steps to meet every term of the equations, few enough to cost milliseconds.
_CHECKED_EPISODES = 4
_CHECKED_STEPS = 24
# A few units in the last place of float32: two honest float64 implementations differ by less.
_TOLERANCE = 1e-5


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
    actions = np.random.default_rng(0).integers(spec.n_actions, size=(_CHECKED_STEPS, _CHECKED_EPISODES))
    observations, outcomes = _kernel_steps(spec, seeds, actions)
    environment = make_gymnasium(spec)
    try:
        for episode, seed in enumerate(seeds):
            observation, _ = environment.reset(seed=int(seed))
            for step in range(_CHECKED_STEPS):
                expected = observations[step, :, episode]
                if not np.allclose(observation, expected, atol=_TOLERANCE, rtol=_TOLERANCE):
                    return False
                observation, reward, terminated, _, _ = environment.step(int(actions[step, episode]))
                if (float(reward), float(terminated)) != tuple(outcomes[step, :, episode]):
                    return False
                if terminated:
                    break
    finally:
        environment.close()
    return True


def _kernel_steps(
    spec: EnvironmentSpec, seeds: NDArray[np.int64], actions: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the observations [T + 1, D, E] of episodes, and their rewards and whether they terminated, [T, 2, E]."""
    dynamics, n = DYNAMICS[spec.id], len(seeds)
    lanes = np.zeros((LANE_ROWS, LANES))
    lanes[:START_ROWS, :n] = dynamics.starts(seeds).T
    observed = slice(OBSERVATION // LANES, OBSERVATION // LANES + spec.n_features)
    observations, outcomes = [lanes[observed, :n].copy()], []
    for chosen in actions:
        lanes[ACTION // LANES, :n] = chosen
        advance(dynamics.index, lanes.reshape(-1), n)
        observations.append(lanes[observed, :n].copy())
        outcomes.append(lanes[[REWARD // LANES, TERMINATED // LANES], :n].copy())
    return np.array(observations), np.array(outcomes)
