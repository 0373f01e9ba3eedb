"""Names that follow from wrappers: keys, states, rows and columns of what was flattened, values of cut actions."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.wrappers import DiscretizeAction, FlattenObservation
from numpy.typing import NDArray

from ge_torchrl.environments.wrappers import OneChoice

# A name tells a value of a cut action within this part of the distance to the next one, in so many decimals at most.
_EXACTLY, _MOST_DECIMALS = 0.01, 12


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


def action_names(environment: gym.Env[Any, Any], n: int, entries: Sequence[str] = ()) -> tuple[str, ...]:
    """Return a name for each action, or for each entry of a continuous one.

    Args:
        environment: Its actions are Discrete, or a flat Box.
        n: How many there are, A.
        entries: What the environment inside all wrappers calls its actions, or entries of an action; empty where it has
            no names for them.

    Returns:
        [A]; those names where there are as many; for a continuous action that is cut into bins, the values of each,
        such as `torque_minus_1_6`; otherwise `a0, a1, ...`.
    """
    cut = _cut(environment)
    names = tuple(entries) if cut is None else _names_of_bins(cut, entries)
    return names if len(set(names)) == n else tuple(f"a{i}" for i in range(n))


def _cut(environment: gym.Env[Any, Any]) -> DiscretizeAction[Any, Any, Any] | None:
    """Return the wrapper that cuts a continuous action, if actions are its bins, in its order."""
    inner = environment
    while isinstance(inner, gym.Wrapper):
        if isinstance(inner, DiscretizeAction):
            return inner
        if isinstance(inner, gym.ActionWrapper) and not isinstance(inner, OneChoice):
            return None
        inner = inner.env
    return None


def _names_of_bins(cut: DiscretizeAction[Any, Any, Any], entries: Sequence[str]) -> tuple[str, ...]:
    n = len(cut.bin_centers)
    # Wrappers further inside may have changed what an entry is.
    if len(entries) != n or cut.env.action_space != cut.unwrapped.action_space:
        entries = ["action"] if n == 1 else [f"a{i}" for i in range(n)]
    values = (
        [f"{entry}_{word}" for word in _words(centers, float(high - low) / len(centers))]
        for entry, centers, low, high in zip(entries, cut.bin_centers, cut.low, cut.high, strict=True)
    )
    return tuple("_".join(of_entries) for of_entries in itertools.product(*values))


def _words(values: NDArray[np.floating[Any]], distance: float) -> list[str]:
    """Return numbers as words that a grammar can hold: letters, digits and `_` for the point."""
    numbers = [float(value) for value in values]
    decimals = next(
        (
            decimals
            for decimals in range(_MOST_DECIMALS)
            if all(abs(round(number, decimals) - number) <= _EXACTLY * distance for number in numbers)
        ),
        _MOST_DECIMALS,
    )
    texts = [f"{round(number, decimals) + 0.0:.{decimals}f}" for number in numbers]
    shortest = (text.rstrip("0").rstrip(".") if "." in text else text for text in texts)
    return [text.replace("-", "minus_").replace(".", "_") for text in shortest]


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
