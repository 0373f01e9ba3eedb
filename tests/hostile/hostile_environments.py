"""Environments that break their word, met as a run meets them: described, opened, and run for some episodes."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import faulty_environments as faulty
import gymnasium as gym
import numpy as np
from environments_for_tests import CountdownEnv, EndlessEnv, register
from hostile_verdicts import PASSED, TOLD, Case

from ge_torchrl.environments.gymnasium_backend import GymnasiumBackend
from ge_torchrl.environments.spec import describe
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree


class LoudEnv(faulty.FailingEnv):
    """Raises a megabyte of escape codes."""

    def fail(self):
        raise RuntimeError("\x1b[31mburning\n" * 100_000)


class _UnspeakableError(Exception):
    def __repr__(self):
        raise ValueError("no words")

    __str__ = __repr__


class UnspeakableEnv(faulty.FailingEnv):
    """Raises what cannot be shown."""

    def fail(self):
        raise _UnspeakableError


class FloodingEnv(CountdownEnv):
    """Writes a hundred kilobytes a step to standard output."""

    def step(self, action):
        sys.stdout.write("flood " * 20_000)
        return super().step(action)


class EndingAtOnceEnv(CountdownEnv):
    """Is over with its first step."""

    def step(self, action):
        observation, reward, *_ = super().step(action)
        return observation, reward, True, False, {}


class ManyActionsEnv(CountdownEnv):
    """Has a billion actions."""

    action_space = gym.spaces.Discrete(10**9)


class NoActionSpaceEnv(CountdownEnv):
    """Has no space of actions."""

    action_space = None


class TextObservationSpaceEnv(CountdownEnv):
    """Observes a text."""

    observation_space = gym.spaces.Text(5)


class PictureEnv(CountdownEnv):
    """Observes pictures."""

    observation_space = gym.spaces.Box(0, 255, (8, 8, 3), np.uint8)


class RaisingAsItIsMadeEnv(CountdownEnv):
    """Cannot be made."""

    def __init__(self, **_):
        raise RuntimeError("no licence")


class WrongTruthEnv(CountdownEnv):
    """Says "maybe" where it should say whether it is over."""

    def step(self, action):
        observation, reward, *_ = super().step(action)
        return observation, reward, np.array([True, False]), False, {}


class SlowEnv(CountdownEnv):
    """Takes a hundredth of a second a step."""

    def step(self, action):
        time.sleep(0.01)
        return super().step(action)


_TOLD = (
    faulty.RaisingEnv, faulty.RaisingInResetEnv, faulty.LeavingEnv, faulty.LeavingInResetEnv, faulty.NaNEnv,
    faulty.NaNRewardEnv, faulty.InfiniteRewardEnv, faulty.OddRewardEnv, faulty.ArrayRewardEnv, faulty.OddObservationEnv,
    faulty.ColumnEnv, faulty.LongEnv, faulty.ScalarEnv, faulty.TextEnv, faulty.FourValuesEnv, faulty.BareResetEnv,
    faulty.TripleResetEnv, LoudEnv, UnspeakableEnv, ManyActionsEnv, NoActionSpaceEnv, TextObservationSpaceEnv,
    PictureEnv, RaisingAsItIsMadeEnv, WrongTruthEnv,
)  # fmt: skip
# They are warned of, cut off, or played as they are.
_TAKEN = (faulty.WideEnv, faulty.InfiniteEnv, FloodingEnv, EndingAtOnceEnv, SlowEnv)


def cases(_: Path) -> Iterator[Case]:
    """Yield all bad environments."""
    for kind, expected in [*((kind, TOLD) for kind in _TOLD), *((kind, PASSED) for kind in _TAKEN)]:
        yield Case(kind.__doc__ or kind.__name__, _meeting(kind), expected)
    yield Case("Never ends.", _meeting(EndlessEnv, max_episode_steps=500), PASSED)
    yield Case("Ends its process.", _killed)


def _meeting(kind: type, workers: int = 1, **described: object) -> Callable[[], None]:
    def meet() -> None:
        with closing(GymnasiumBackend(describe(register(kind), **described), workers)) as backend:
            backend.evaluate(Forest.stack([DecisionTree.leaf(0)]), np.arange(4), "fitness")

    return meet


def _killed() -> None:
    os.environ["TEST_ENVIRONMENT_LIVES_IN"] = str(os.getpid())
    try:
        _meeting(faulty.DyingEnv, workers=2)()
    finally:
        del os.environ["TEST_ENVIRONMENT_LIVES_IN"]
