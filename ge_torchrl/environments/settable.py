"""Environments whose state can be set: `state`, as in classic control, or MuJoCo's positions and speeds."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.border import random_action
from ge_torchrl.environments.making import FAULTS
from ge_torchrl.environments.spec import EnvironmentSpec, make_gymnasium
from ge_torchrl.seeding import stream

_EPISODES: Final = 8
_STEPS: Final = 25
# Steps are made, made again from their states, and made from the mirrored ones.
_TIMES_PLAYED: Final = 3
_OBSERVERS: Final = ("_get_obs", "_get_ob")


@dataclass(frozen=True, eq=False)
class Step:
    """A step of an environment.

    Attributes:
        state: [N] float64, before the step.
        before: [D] float32, the observation of that state.
        action: The number of an action, counted from 0, or its entries.
        observation: [D] float32, after the step.
        reward: Of the step.
        terminated: Whether the task ended the episode.
    """

    state: NDArray[np.float64]
    before: NDArray[np.float32]
    action: Any
    observation: NDArray[np.float32]
    reward: float
    terminated: bool


class Settable:
    """An environment whose state can be read and set.

    Args:
        spec: The environment.

    Attributes:
        steps: What random policies did in it.
    """

    def __init__(self, spec: EnvironmentSpec) -> None:
        self._spec = spec
        self._environment = make_gymnasium(spec)
        self._inner: Any = self._environment.unwrapped
        self._observer = next(
            (getattr(self._inner, name) for name in _OBSERVERS if hasattr(self._inner, name)), None
        )
        self.steps: list[Step] = []

    def play(self, seconds: float) -> None:
        """Act at random, and write the steps down; after so many seconds no more of them."""
        rng, deadline = stream(0, "steps to be mirrored"), time.perf_counter() + seconds
        for seed in range(_EPISODES):
            if self.steps and time.perf_counter() > deadline:
                break
            self._environment.reset(seed=seed)
            state, ended = self._state(), False
            while not ended and len(self.steps) < (seed + 1) * _STEPS:
                self.steps.append(self._step(state, random_action(self._spec, rng)))
                state, ended = self._state(), self.steps[-1].terminated
                ended |= time.perf_counter() > deadline

    def is_true(self) -> bool:
        """Tell whether setting a state sets all: then the same steps, in another order, come out the same."""
        for step in reversed(self.steps):
            again = self.step_from(step.state, step.action)
            is_same = (again.reward, again.terminated) == (step.reward, step.terminated)
            if not (is_same and np.allclose(again.observation, step.observation, atol=1e-5, rtol=1e-5)):
                return False
        return all(
            np.allclose(one.observation, other.before, atol=1e-6)
            for one, other in zip(self.steps[:_STEPS], self.steps[1:_STEPS], strict=False)
            if not one.terminated
        )

    def step_from(self, state: NDArray[np.float64], action: Any) -> Step:
        """Take an action in a state."""
        # An environment may keep in mind that an episode ended.
        self._environment.reset(seed=0)
        self._set(state)
        return self._step(state, action)

    def observed(self, state: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return the observation [D] of a state."""
        if self._observer is None:
            return state.astype(np.float32)
        self._set(state)
        return np.asarray(self._observer(), np.float32)

    def close(self) -> None:
        """Close the environment."""
        self._environment.close()

    def _step(self, state: NDArray[np.float64], action: Any) -> Step:
        spec = self._spec
        before = self.observed(state)
        given = np.array(action, np.float32) if spec.is_continuous else action + spec.first_action
        observation, reward, terminated, _, _ = self._environment.step(given)
        return Step(
            state, before, action, np.asarray(observation, np.float32), float(reward), bool(terminated)
        )

    def _state(self) -> NDArray[np.float64]:
        inner = self._inner
        if _is_mujoco(inner):
            return np.concatenate([inner.data.qpos, inner.data.qvel])
        return np.array(inner.state, np.float64)

    def _set(self, state: NDArray[np.float64]) -> None:
        inner = self._inner
        if _is_mujoco(inner):
            n = len(inner.data.qpos)
            inner.set_state(state[:n], state[n:])
        else:
            inner.state = state.copy()


def settable(spec: EnvironmentSpec, seconds: float) -> Settable | None:
    """Open an environment if its state can be set and observed, and is all there is to it.

    Args:
        spec: The environment; with wrappers it is not known what is observed of a state.
        seconds: How long its steps may take, of which there are fewer then [s].
    """
    if spec.names.wrappers:
        return None
    opened = Settable(spec)
    try:
        opened.play(seconds / _TIMES_PLAYED)
        is_settable = len(opened.steps[0].state) > 0 and opened.is_true()
    except FAULTS:
        # Whatever stands in for a state there, it is none.
        is_settable = False
    if not is_settable:
        opened.close()
    return opened if is_settable else None


def _is_mujoco(inner: Any) -> bool:
    return hasattr(inner, "set_state") and hasattr(getattr(inner, "data", None), "qpos")
