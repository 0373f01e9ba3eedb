"""The choice of a route: compiled where that is the same environment, Gymnasium everywhere."""

from __future__ import annotations

import logging

import numpy as np

from ge_torchrl.environments.compiled_route import CompiledRoute
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
from ge_torchrl.environments.gymnasium_route import GymnasiumRoute
from ge_torchrl.environments.route import Route
from ge_torchrl.environments.spec import EnvironmentSpec, make_gymnasium

_logger = logging.getLogger(__name__)

# Enough steps to meet every term of the equations, few enough to cost milliseconds.
_CHECKED_EPISODES = 4
_CHECKED_STEPS = 24
# A few units in the last place of float32: two honest float64 implementations differ by less.
_TOLERANCE = 1e-5


def open_route(spec: EnvironmentSpec, route: str = "auto", threads: int = 0, workers: int = 0) -> Route:
    """Open the way to run trees in an environment.

    `auto` takes the compiled route where compiled dynamics exist and the installed Gymnasium agrees with them on a
    few steps, tried on the spot; else the Gymnasium route.

    Args:
        spec: The environment.
        route: "auto", "compiled" or "gymnasium".
        threads: Threads of the compiled route, 0 for one a core.
        workers: Processes of the Gymnasium route, 0 for one a core where that pays.

    Raises:
        EnvironmentFaultError: "compiled" was asked for where there are no compiled dynamics.
    """
    if route == "compiled" or (route == "auto" and spec.id in DYNAMICS and _agrees_or_warns(spec)):
        return CompiledRoute(spec, threads)
    return GymnasiumRoute(spec, workers)


def _agrees_or_warns(spec: EnvironmentSpec) -> bool:
    agrees = agrees_with_gymnasium(spec)
    if not agrees:
        _logger.warning(
            "The installed Gymnasium's %s differs from the compiled dynamics; running Gymnasium itself.",
            spec.id,
        )
    return agrees


def agrees_with_gymnasium(spec: EnvironmentSpec) -> bool:
    """Tell whether compiled dynamics and the installed Gymnasium give the same first steps of a few episodes."""
    dynamics = DYNAMICS[spec.id]
    seeds = np.arange(_CHECKED_EPISODES)
    lanes = np.zeros((LANE_ROWS, LANES))
    lanes[:START_ROWS, :_CHECKED_EPISODES] = dynamics.starts(seeds).T
    environment = make_gymnasium(spec.id)
    rng = np.random.default_rng(0)
    actions = rng.integers(spec.n_actions, size=(_CHECKED_STEPS, _CHECKED_EPISODES))
    rows = slice(OBSERVATION // LANES, OBSERVATION // LANES + spec.n_features)
    ours = [lanes[rows, :_CHECKED_EPISODES].copy()]
    outcomes = []
    for step in range(_CHECKED_STEPS):
        lanes[ACTION // LANES, :_CHECKED_EPISODES] = actions[step]
        advance(dynamics.index, lanes.reshape(-1), _CHECKED_EPISODES)
        ours.append(lanes[rows, :_CHECKED_EPISODES].copy())
        outcomes.append(lanes[[REWARD // LANES, TERMINATED // LANES], :_CHECKED_EPISODES].copy())
    for episode, seed in enumerate(seeds):
        observation, _ = environment.reset(seed=int(seed))
        for step in range(_CHECKED_STEPS):
            if not np.allclose(observation, ours[step][:, episode], atol=_TOLERANCE, rtol=_TOLERANCE):
                return False
            observation, reward, terminated, _, _ = environment.step(int(actions[step, episode]))
            if (float(reward), float(terminated)) != tuple(outcomes[step][:, episode]):
                return False
            if terminated:
                break
    environment.close()
    return True
