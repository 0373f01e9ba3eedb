"""Which spaces trees can live with, and what to type where they cannot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ge_torchrl.environments.wrappers import is_continuous_throughout, n_combinations
from ge_torchrl.errors import EnvironmentFaultError

_OURS = "ge_torchrl.environments.wrappers"
# A person does not read a leaf that is one of more choices.
_MOST_COMBINATIONS = 1000
# Nor names of more.
_MOST_NAMES = 100_000


def space_of(environment: gym.Env[Any, Any], name: str, environment_id: str) -> spaces.Space[Any]:
    """Return a space of an environment.

    Args:
        environment: May have forgotten it.
        name: `action_space` or `observation_space`.
        environment_id: Of the environment.

    Raises:
        EnvironmentFaultError: There is none, or it is something else.
    """
    try:
        space = getattr(environment, name)
    except (Exception, SystemExit) as error:  # noqa: BLE001 - whatever it raises, it has no space.
        got = f"none ({one_line(error)})"
    else:
        if isinstance(space, spaces.Space):
            return space
        got = one_line(space)
    raise EnvironmentFaultError(
        f"env.id={environment_id} must have {name}, a space of gymnasium.spaces, set where it is made; got {got}"
    )


def observed_box(space: spaces.Space[Any], environment_id: str, wrappers: Sequence[str]) -> spaces.Box:
    """Return a space of observations if it is a flat Box.

    Args:
        space: What is observed.
        environment_id: Of the environment.
        wrappers: Those around it already.

    Raises:
        EnvironmentFaultError: It is not; the message names the override that helps.
    """
    if isinstance(space, spaces.Box) and len(space.shape) == 1 and space.shape[0] > 0:
        _check_number(space.shape[0], "observe", "numbers", environment_id)
        return space
    raise _refusal(
        f"env.id={environment_id} must observe a flat Box, since a split compares numbers; got {one_line(space)}",
        _observation_remedy(space, environment_id, wrappers),
    )


def action_bounds(
    space: spaces.Space[Any], environment_id: str, wrappers: Sequence[str]
) -> tuple[tuple[float, float], ...]:
    """Return the bounds of each entry of a continuous action; none where actions are Discrete.

    Args:
        space: Of actions.
        environment_id: Of the environment.
        wrappers: Those around it already.

    Raises:
        EnvironmentFaultError: It is neither Discrete nor a flat Box of floats; the message names the override that
            helps.
    """
    if isinstance(space, spaces.Discrete):
        _check_number(int(space.n), "have", "actions", environment_id)
        return ()
    if isinstance(space, spaces.Box) and len(space.shape) == 1 and space.shape[0] and space.dtype.kind == "f":
        _check_number(space.shape[0], "take", "numbers", environment_id)
        low, high = float32_bounds(space)
        # A float64 bound may lie between two float32s: the environment refuses the outer one.
        low = np.where(np.isfinite(low) & (low < space.low), np.nextafter(low, np.float32(np.inf)), low)
        high = np.where(
            np.isfinite(high) & (high > space.high), np.nextafter(high, np.float32(-np.inf)), high
        )
        return tuple(zip(low.tolist(), high.tolist(), strict=True))
    raise _refusal(
        f"env.id={environment_id} must have Discrete actions, or a flat Box of floats, since a leaf holds one choice "
        f"or a row of numbers; got {one_line(space)}",
        _action_remedy(space, wrappers),
    )


def _check_number(n: int, does: str, things: str, environment_id: str) -> None:
    if n > _MOST_NAMES:
        raise EnvironmentFaultError(
            f"env.id={environment_id} must {does} at most {_MOST_NAMES} {things}, because each has a name in a tree; "
            f"got {n}"
        )


def float32_bounds(space: spaces.Box) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the bounds of a Box, each of its own shape."""
    # A float64 bound may lie beyond every float32: it is none.
    with np.errstate(over="ignore"):
        return space.low.astype(np.float32), space.high.astype(np.float32)


def one_line(value: object) -> str:
    """Return what Gymnasium says of something, in one line."""
    text = " ".join(str(value).split())
    return text if len(text) <= 300 else f"{text[:297]}..."


def _observation_remedy(space: spaces.Space[Any], environment_id: str, wrappers: Sequence[str]) -> str:
    if not _is_flattenable(space):
        return _remedy_of_parts(space, wrappers)
    typed = _typed(wrappers, "gymnasium.wrappers:FlattenObservation")
    n = math.prod(spaces.flatten_space(space).shape or ())
    flattened = f"{typed} makes one, of {n} numbers"
    if "ALE/" in environment_id and isinstance(space, spaces.Box):
        return f"{flattened}; env.kwargs.obs_type=ram makes one of 128"
    return flattened


def _remedy_of_parts(space: spaces.Space[Any], wrappers: Sequence[str]) -> str:
    """Return what to type where some parts of a Dict have no flat form, such as a sentence."""
    parts = space.items() if isinstance(space, spaces.Dict) else ()
    keys = [key for key, part in parts if _is_flattenable(part)]
    if not keys:
        return ""
    kept = f"gymnasium.wrappers:FilterObservation {{filter_keys: [{', '.join(keys)}]}}"
    typed = _typed((*wrappers, kept), "gymnasium.wrappers:FlattenObservation")
    return f"{typed} makes one of those parts that are numbers"


def _is_flattenable(space: spaces.Space[Any]) -> bool:
    try:
        return space.is_np_flattenable
    except NotImplementedError:
        # So Gymnasium answers for a space that somebody else wrote.
        return False


def _action_remedy(space: spaces.Space[Any], wrappers: Sequence[str]) -> str:
    if isinstance(space, spaces.MultiDiscrete | spaces.MultiBinary):
        n = n_combinations(space)
        if n > _MOST_COMBINATIONS:
            return ""
        return f"{_typed(wrappers, f'{_OURS}:OneChoice')} makes one choice of the {n} combinations"
    if is_continuous_throughout(space):
        return f"{_typed(wrappers, f'{_OURS}:FlatActions')} makes a flat Box of them"
    return ""


def _typed(wrappers: Sequence[str], another: str) -> str:
    """Return what a user types for one more wrapper."""
    quoted = (f'"{wrapper}"' if "{" in wrapper else wrapper for wrapper in (*wrappers, another))
    return f"env.wrappers='[{','.join(quoted)}]'"


def _refusal(what: str, remedy: str) -> EnvironmentFaultError:
    own = "a wrapper of your own can make one: env.wrappers='[my_module:MyWrapper]'"
    return EnvironmentFaultError(f"{what}; {remedy or own}")
