"""The choice of a backend: a kernel where that is the same environment, Gymnasium everywhere."""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import closing
from functools import partial
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import Backend
from ge_torchrl.environments.gymnasium_backend import GymnasiumBackend
from ge_torchrl.environments.kernel_backend import KernelBackend
from ge_torchrl.environments.kernel_choice import dynamics_of, has_kernel
from ge_torchrl.environments.kernels.dynamics import advance
from ge_torchrl.environments.kernels.lanes import (
    ACTION,
    LANE_ROWS,
    LANES,
    OBSERVATION,
    REWARD,
    TERMINATED,
)
from ge_torchrl.environments.making import FAULTS, GymEnvironment
from ge_torchrl.environments.plants.plant import names_plant
from ge_torchrl.environments.spec import EnvironmentSpec, make_gymnasium
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.printing import said_of

_Result = TypeVar("_Result")
_logger = logging.getLogger(__name__)


class _Tried(NamedTuple):
    """On what a kernel is tried, and how far it may be from Gymnasium."""

    episodes: int
    steps: int
    tolerance: float
    reward_tolerance: float


# Enough steps to meet every term of the equations, few enough to cost milliseconds. A few units in the last place of
# float32: two honest float64 implementations differ by less. Rewards that are no constants are rounded too.
_OF_OURS = _Tried(4, 24, 1e-5, 1e-6)
# The same code, so the same numbers. Eleven lanes are a whole vector and more.
_OF_A_PLANT = _Tried(11, 200, 0.0, 0.0)


def open_backend(spec: EnvironmentSpec, route: str = "auto", threads: int = 0, workers: int = 0) -> Backend:
    """Open the backend that runs trees in an environment.

    `auto` takes the kernel where there is one and the installed Gymnasium agrees with it on a few steps, tried on the
    spot; else Gymnasium itself. A plant is refused where they do not agree.

    Args:
        spec: The environment.
        route: "auto", "kernel" or "gymnasium".
        threads: Threads of the kernel, 0 for one a core.
        workers: Processes of Gymnasium, 0 for one a core where that pays.

    Raises:
        EnvironmentFaultError: "kernel" was asked for where there is none, or a plant does not step alike on both.
        ValueError: There is no such route.
    """
    if route not in {"auto", "kernel", "gymnasium"}:
        raise ValueError(f'env.route must be "auto", "kernel" or "gymnasium"; got {route!r}')
    if route != "gymnasium" and names_plant(spec.id) and has_kernel(spec):
        check_plant(spec)
        return KernelBackend(spec, threads)
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


def check_plant(spec: EnvironmentSpec) -> None:
    """Refuse a plant whose kernel and Gymnasium environment do not give the same episodes.

    Raises:
        EnvironmentFaultError: They do not, or a step is at fault.
    """
    if difference := _first_difference(spec):
        raise EnvironmentFaultError(
            f"env.dynamics={spec.id} must step alike wherever it is compiled, so that the same seed gives the same "
            f"episode; {difference}; a step may read its state and action and constants alone: draw random numbers in "
            "start, and compile without fastmath"
        )


def agrees_with_gymnasium(spec: EnvironmentSpec) -> bool:
    """Tell whether the kernel and the installed Gymnasium give the same first steps of a few episodes."""
    return _first_difference(spec) is None


def _first_difference(spec: EnvironmentSpec) -> str | None:
    """Return where the kernel and Gymnasium first differ, in words; None where a few episodes are the same."""
    tried = _OF_A_PLANT if names_plant(spec.id) else _OF_OURS
    seeds = np.arange(tried.episodes)
    actions = _any_actions(spec, (tried.steps, tried.episodes))
    observations, outcomes = _kernel_steps(spec, seeds, actions)
    with closing(make_gymnasium(spec)) as environment:
        for seed in seeds.tolist():
            of_kernel = observations[:, :, seed], outcomes[:, :, seed]
            if difference := _difference(spec, environment, seed, actions[:, seed], of_kernel, tried):
                return difference
    return None


def _difference(
    spec: EnvironmentSpec,
    environment: GymEnvironment,
    seed: int,
    actions: NDArray[Any],
    of_kernel: tuple[NDArray[np.float64], NDArray[np.float64]],
    tried: _Tried,
) -> str | None:
    """Compare one episode with the kernel's observations [T + 1, D] and outcomes [T, 2]."""
    observation = _told(lambda: environment.reset(seed=seed), f"{spec.id}, episode seed {seed}")[0]
    for step, expected in enumerate(of_kernel[0]):
        same = np.isclose(observation, expected, atol=tried.tolerance, rtol=tried.tolerance)
        if not same.all():
            feature = int(np.argmin(same))
            return (
                f"from seed {seed}, after {step} steps, {spec.names.features[feature]} = {expected[feature]:.9g} in "
                f"the kernel and {observation[feature]:.9g} in Gymnasium"
            )
        if step == len(actions):
            break
        action = actions[step] if spec.is_continuous else int(actions[step])
        where = f"{spec.id}, episode seed {seed}, step {step}, action {action}"
        observation, reward, terminated, _, _ = _told(partial(environment.step, action), where)
        expected_reward, expected_end = of_kernel[1][step]
        if not abs(float(reward) - expected_reward) <= tried.reward_tolerance or terminated != expected_end:
            return (
                f"from seed {seed}, in step {step + 1}, the reward is {expected_reward:.17g} in the kernel and "
                f"{float(reward):.17g} in Gymnasium, and the task is ended {bool(expected_end)} and {terminated}"
            )
        if terminated:
            break
    return None


def _told(act: Callable[[], _Result], where: str) -> _Result:
    """Return what an environment gives back; tell in one line what it raises."""
    try:
        return act()
    except FAULTS as error:
        raise EnvironmentFaultError(f"{where}: it raised {said_of(error)}") from error


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
    dynamics, n = dynamics_of(spec), len(seeds)
    if dynamics is None:
        raise ValueError(f"{spec.id} has no kernel")
    lanes, starts = np.zeros((LANE_ROWS, LANES)), dynamics.starts(seeds)
    lanes[: starts.shape[1], :n] = starts.T
    observed = slice(OBSERVATION // LANES, OBSERVATION // LANES + spec.n_features)
    observations, outcomes = [lanes[observed, :n].copy()], []
    for chosen in actions.reshape(len(actions), n, -1):
        lanes[ACTION // LANES : ACTION // LANES + chosen.shape[1], :n] = chosen.T
        advance(dynamics.index, lanes.reshape(-1), n)
        observations.append(lanes[observed, :n].copy())
        outcomes.append(lanes[[REWARD // LANES, TERMINATED // LANES], :n].copy())
    return np.array(observations), np.array(outcomes)
