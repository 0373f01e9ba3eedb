"""Wrappers for what Gymnasium has none: actions of other kinds, made into what a leaf can hold.

They are chosen like any other, `env.wrappers=[ge_torchrl.environments.wrappers:OneChoice]`.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray


class OneChoice(gym.ActionWrapper[Any, Any, Any]):
    """Several choices at once, MultiDiscrete or MultiBinary, as one: each combination has a number.

    Combinations are numbered from 0, the last choice the quickest to change.

    Args:
        env: The environment.

    Raises:
        TypeError: Its actions are of another kind.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        space = env.action_space
        if isinstance(space, spaces.MultiDiscrete):
            choices, self._start = space.nvec, space.start
        elif isinstance(space, spaces.MultiBinary):
            choices, self._start = np.full(space.shape, 2), np.zeros(space.shape, np.int64)
        else:
            raise TypeError(f"OneChoice takes MultiDiscrete or MultiBinary actions; got {space}")
        self._shape, self._choices, self._dtype = choices.shape, choices.reshape(-1), space.dtype
        self.action_space = spaces.Discrete(n_combinations(space))

    def action(self, action: Any) -> NDArray[Any]:
        """Return the combination of a number."""
        chosen = np.array(np.unravel_index(int(action), self._choices.tolist()))
        return (chosen.reshape(self._shape) + self._start).astype(self._dtype)


class FlatActions(gym.ActionWrapper[Any, Any, Any]):
    """Continuous actions of another shape, or several together in a Dict or Tuple, as one row of numbers.

    Args:
        env: The environment.

    Raises:
        TypeError: Its actions are not made of continuous ones alone.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        if not is_continuous_throughout(env.action_space):
            raise TypeError(
                f"FlatActions takes Box actions of floats, or several of them; got {env.action_space}"
            )
        self.action_space = spaces.flatten_space(env.action_space)

    def action(self, action: Any) -> Any:
        """Return the action in the shape that the environment takes."""
        return spaces.unflatten(self.env.action_space, np.asarray(action))


def n_combinations(space: spaces.MultiDiscrete | spaces.MultiBinary) -> int:
    """Return how many combinations several choices have."""
    choices = space.nvec.reshape(-1) if isinstance(space, spaces.MultiDiscrete) else np.full(space.shape, 2)
    total = 1
    for n in choices.reshape(-1).tolist():
        total *= n
    return total


def is_continuous_throughout(space: spaces.Space[Any]) -> bool:
    """Tell whether a space is made of Boxes of floats alone."""
    if isinstance(space, spaces.Dict):
        return all(map(is_continuous_throughout, space.values()))
    if isinstance(space, spaces.Tuple):
        return all(map(is_continuous_throughout, space))
    return isinstance(space, spaces.Box) and space.dtype.kind == "f"
