"""A plant as a Gymnasium environment, for everybody who steps one: TorchRL, worker processes, other programs.

gymnasium.make(register_plant("plant.py:Cart"))
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from ge_torchrl.environments.plants.kernel import first_states, plant_kernel
from ge_torchrl.interrupts import Stepping

_Observation = NDArray[np.float32]
_State = NDArray[np.float64]


class PlantEnvironment(gym.Env[_Observation, Any]):
    """Steps a plant by the code that its kernel runs.

    Args:
        dynamics: Of the plant, `file.py:Class`.
        numbers: By name, what takes the place of numbers in its file.

    Raises:
        EnvironmentFaultError: The plant is not there, or something in it is missing or wrong.
    """

    def __init__(self, dynamics: str, **numbers: Any) -> None:
        self._kernel = plant_kernel(dynamics, numbers)
        self._plant = self._kernel.plant
        actions, n_features = self._plant.actions, len(self._plant.features)
        self.observation_space = spaces.Box(-np.inf, np.inf, (n_features,), np.float32)
        low, high = np.array(actions.bounds or [(0.0, 0.0)], np.float32).T
        self.action_space = (
            spaces.Box(low, high, dtype=np.float32) if actions.bounds else spaces.Discrete(len(actions.names))
        )
        self._state: tuple[float, ...] = ()

    @property
    def state(self) -> _State:
        """[N] float64, the state as it is now; may be set, as in classic control."""
        return np.array(self._state)

    @state.setter
    def state(self, state: ArrayLike) -> None:
        self._state = tuple(np.asarray(state, np.float64).tolist())

    def _get_obs(self) -> _Observation:
        return np.array(self._kernel.observation(self._state), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[_Observation, dict[str, Any]]:
        """Begin an episode: every entry of the state is uniform within its bounds.

        Raises:
            FloatingPointError: What is observed is infinite or no number.
        """
        super().reset(seed=seed, options=options)
        drawn = self.np_random.random(len(self._plant.start))
        self.state = first_states(self._plant, drawn)
        seen = self._get_obs()
        if not np.isfinite(seen).all():
            raise FloatingPointError(
                f"what is observed of the first state, {self._state}, is not finite: {seen.tolist()}"
            )
        return seen, {}

    def step(self, action: Any) -> tuple[_Observation, float, bool, bool, dict[str, Any]]:
        """Take the number of an action, or values [A], which are cut to their bounds.

        Raises:
            FloatingPointError: State, observation or reward is infinite or no number.
        """
        Stepping.since = time.perf_counter()
        self._state, seen, reward, terminated, is_finite = self._kernel.step(self._state, self._given(action))
        Stepping.since = math.inf
        if not is_finite:
            raise FloatingPointError(
                f"the step gave back what is infinite or no number: state {self._state}, observation {seen}, "
                f"reward {reward}"
            )
        return np.array(seen, np.float32), reward, terminated, False, {}

    def _given(self, action: Any) -> Any:
        actions = self._plant.actions
        if not actions.bounds:
            return actions.values[int(action)] if actions.values else int(action)
        values: list[float] = np.asarray(action, np.float32).tolist()
        # NumPy takes ten times as long for so few.
        entries = [
            min(max(value, low), high) for value, (low, high) in zip(values, actions.bounds, strict=True)
        ]
        return entries[0] if len(entries) == 1 else tuple(entries)


def register_plant(dynamics: str, numbers: Mapping[str, Any] | None = None) -> str:
    """Tell Gymnasium of a plant, in this process; return the id by which `gymnasium.make` makes it.

    Args:
        dynamics: Of the plant, `file.py:Class`.
        numbers: By name, what takes the place of numbers in its file.

    Raises:
        EnvironmentFaultError: The plant is not there, or something in it is missing or wrong.
    """
    plant = plant_kernel(dynamics, numbers).plant
    file, _, name = dynamics.rpartition(":")
    place = re.sub(r"\W+", "_", file.removesuffix(".py")).strip("_")
    environment_id = f"{place}/{name}-v0"
    # The file may have changed since.
    gym.registry.pop(environment_id, None)
    gym.register(
        environment_id,
        "ge_torchrl.environments.plants.environment:PlantEnvironment",
        reward_threshold=plant.solved_at,
        max_episode_steps=plant.max_episode_steps,
        kwargs={"dynamics": dynamics, **(numbers or {})},
    )
    return environment_id
