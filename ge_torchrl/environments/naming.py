"""Names of features that Gymnasium knows: of what a wrapper flattened, keys, numbers of states, rows and columns."""

from __future__ import annotations

import itertools
import re
from typing import Any

import gymnasium as gym
from gymnasium import spaces
from gymnasium.wrappers import FlattenObservation


def feature_names(environment: gym.Env[Any, Any]) -> tuple[str, ...]:
    """Return a name for each entry of an environment's flat observation.

    Args:
        environment: It observes a flat Box.

    Returns:
        [D]; for a Dict that is flattened, `key` or `key_0, key_1, ...`; for a Tuple, `part0` or `part0_0, ...`; for
        one of so many states, `state_0, ...`; for a table or a picture, `x_0_0, x_0_1, ...`; otherwise `x0, x1, ...`.
    """
    n = int(environment.observation_space.shape[0])  # type: ignore[index]
    space = _flattened(environment)
    names = [] if space is None else [re.sub(r"\W", "_", name) for name in _names_within(space, "")]
    if len(names) == n and len(set(names)) == n and all(re.match(r"[A-Za-z]", name) for name in names):
        return tuple(names)
    return tuple(f"x{i}" for i in range(n))


def _flattened(environment: gym.Env[Any, Any]) -> spaces.Space[Any] | None:
    """Return what the outermost wrapper of the observation flattens, if that is what it does."""
    inner = environment
    while isinstance(inner, gym.Wrapper):
        if isinstance(inner, FlattenObservation):
            return inner.env.observation_space
        if inner.observation_space != inner.env.observation_space:
            return None
        inner = inner.env
    return None


def _names_within(space: spaces.Space[Any], prefix: str) -> list[str]:
    """Return the names of the entries of a space, in the order in which Gymnasium flattens it."""
    if isinstance(space, spaces.Dict):
        below = f"{prefix}_" if prefix else ""
        return [name for key, part in space.items() for name in _names_within(part, f"{below}{key}")]
    if isinstance(space, spaces.Tuple):
        below = f"{prefix}_" if prefix else "part"
        return [name for i, part in enumerate(space) for name in _names_within(part, f"{below}{i}")]
    if isinstance(space, spaces.Discrete):
        return [f"{prefix or 'state'}_{space.start + i}" for i in range(int(space.n))]
    if isinstance(space, spaces.Box) and len(space.shape) > 1:
        places = itertools.product(*map(range, space.shape))
        return ["_".join([prefix or "x", *map(str, place)]) for place in places]
    n = spaces.flatdim(space)
    if not prefix:
        return [f"x{i}" for i in range(n)]
    return [prefix] if n == 1 else [f"{prefix}_{i}" for i in range(n)]
