"""Wrappers that carry something from one episode to the next, such as averages of all that was observed."""

from __future__ import annotations

import math
import time
from contextlib import closing
from copy import deepcopy
from typing import Any

from gymnasium.utils.env_checker import data_equivalence

from ge_torchrl.environments.making import FAULTS, GymEnvironment, make
from ge_torchrl.environments.spec import EnvironmentSpec

# The episode that is played twice, at random; of a slow environment [s] less of it.
_SEED, _STEPS, _SECONDS = 7, 50, 2.0


def carrying_wrappers(spec: EnvironmentSpec) -> tuple[str, ...]:
    """Return the wrappers that make an episode depend on those before it.

    They are found from the inside: with each one it is tried whether the same seed still gives the same episode, and
    one with which it does not is left out from there on.

    Args:
        spec: An environment of which the same seed gives another episode each time.

    Returns:
        The wrappers; none where the environment itself does not obey its seeds, or where it cannot be told.
    """
    names, kept, carrying = spec.names, list[str](), list[str]()
    limit = spec.max_episode_steps if spec.has_limit else None
    try:
        if not _repeats(make(spec.id, limit, names.kwargs, ())):
            return ()
        for wrapper in names.wrappers:
            repeats = _repeats(make(spec.id, limit, names.kwargs, (*kept, wrapper)))
            (kept if repeats else carrying).append(wrapper)
    except FAULTS:
        # A wrapper may need one that was left out.
        pass
    return tuple(carrying)


def _repeats(environment: GymEnvironment) -> bool:
    with closing(environment):
        first = _episode(environment, _STEPS, _SECONDS)
        return data_equivalence(first, _episode(environment, len(first) - 1, math.inf), exact=True)


def _episode(environment: GymEnvironment, n_steps: int, seconds: float) -> list[Any]:
    deadline = time.perf_counter() + seconds
    told: list[Any] = [deepcopy(environment.reset(seed=_SEED)[0])]
    environment.action_space.seed(_SEED)
    for _ in range(n_steps):
        *outcome, _ = environment.step(environment.action_space.sample())
        # Some environments give the same array back each time.
        told.append(deepcopy(outcome))
        if outcome[2] or outcome[3] or time.perf_counter() > deadline:
            break
    return told
