"""Gymnasium environments that break their word, each in one way."""

import os
import time

import gymnasium as gym
import numpy as np
from environments_for_tests import CountdownEnv, ThrustEnv, WalkEnv

from ge_torchrl.seeding import episode_seeds, stream


class FailingEnv(CountdownEnv):
    """Fails in its third step, each subclass in its own way."""

    def step(self, action):
        if self.steps == 2:
            self.fail()
        return super().step(action)


class RaisingEnv(FailingEnv):
    """Raises in its third step."""

    def fail(self):
        raise RuntimeError("the motor\nis on fire")


class RaisingInResetEnv(CountdownEnv):
    """Raises in reset."""

    def reset(self, **_):
        raise RuntimeError("no fuel")


class BareResetEnv(CountdownEnv):
    """Gives back the observation alone, of two entries."""

    def reset(self, **given):
        return super().reset(**given)[0]


class TripleResetEnv(CountdownEnv):
    """Gives back three values in reset."""

    def reset(self, **given):
        return (*super().reset(**given), None)


class LeavingEnv(FailingEnv):
    """Ends the program in its third step."""

    def fail(self):
        raise SystemExit("licence expired")


class LeavingInResetEnv(CountdownEnv):
    """Ends the program in reset."""

    def reset(self, **_):
        raise SystemExit(3)


class NaNEnv(CountdownEnv):
    """Observes NaN after its second step."""

    def step(self, action):
        observation, *rest = super().step(action)
        return (observation * np.nan if self.steps == 2 else observation, *rest)


class OddRewardEnv(CountdownEnv):
    """Pays what is no number in its first step."""

    reward = None

    def step(self, action):
        observation, _, *rest = super().step(action)
        return (observation, self.reward, *rest)


class NaNRewardEnv(OddRewardEnv):
    """Pays NaN."""

    reward = float("nan")


class InfiniteRewardEnv(OddRewardEnv):
    """Pays infinity."""

    reward = np.float32(-np.inf)


class ArrayRewardEnv(OddRewardEnv):
    """Pays an array."""

    reward = np.ones(1)


class OddObservationEnv(CountdownEnv):
    """Observes something else than it says after its first step."""

    observation = None

    def step(self, action):
        _, *rest = super().step(action)
        return (self.observation, *rest)


class ColumnEnv(OddObservationEnv):
    """Observes a column."""

    observation = np.zeros((2, 1), np.float32)


class LongEnv(OddObservationEnv):
    """Observes one number too many."""

    observation = np.zeros(3, np.float32)


class ScalarEnv(OddObservationEnv):
    """Observes one number."""

    observation = 0.5


class TextEnv(OddObservationEnv):
    """Observes texts."""

    observation = ("left", "right")


class FourValuesEnv(CountdownEnv):
    """Steps as Gym did before Gymnasium."""

    def step(self, action):
        return super().step(action)[:4]


class DyingEnv(CountdownEnv):
    """Ends its process, but not in the one that made the module's first copy."""

    def step(self, action):
        if os.environ.get("TEST_ENVIRONMENT_LIVES_IN") != str(os.getpid()):
            os._exit(3)
        return super().step(action)


class DyingLateEnv(WalkEnv):
    """Ends its process in the first test episode of a run of seed 0."""

    def reset(self, *, seed=None, options=None):
        if seed == int(episode_seeds("test", 5, stream(0, "test episodes"))[0]):
            os._exit(3)
        return super().reset(seed=seed, options=options)


class WideEnv(WalkEnv):
    """Says that it observes [0, 1], and observes up to 4."""

    observation_space = gym.spaces.Box(0, 1, (2,), np.float32)

    def observe(self):
        return np.array([min(abs(self.place), 4), self.place % 2], np.float32)


class InfiniteEnv(WalkEnv):
    """Observes infinity in its second entry, always; declares no bounds for it."""

    observation_space = gym.spaces.Box(np.float32([-5, -np.inf]), np.float32([5, np.inf]))

    def observe(self):
        return np.array([self.place, np.inf], np.float32)


class LateEnv(WalkEnv):
    """Keeps its bounds in every episode but that of seed 9999."""

    observation_space = gym.spaces.Box(-5, 5, (2,), np.float32)

    def reset(self, *, seed=None, options=None):
        self.is_late = seed == 9999
        return super().reset(seed=seed, options=options)

    def observe(self):
        return np.array([self.place, 7 if self.is_late else 0], np.float32)


class LateNaNEnv(WalkEnv):
    """The walk, which observes NaN in its third step in the episode of seed 9999."""

    def reset(self, *, seed=None, options=None):
        self.seen = 0 if seed == 9999 else -(10**9)
        return super().reset(seed=seed, options=options)

    def observe(self):
        self.seen += 1
        return super().observe() * np.float32(np.nan if self.seen == 4 else 1)


class LateNaNThrustEnv(ThrustEnv):
    """Takes two numbers, and observes NaN in its second step in the episode of seed 9999."""

    def reset(self, *, seed=None, options=None):
        self.is_bad = seed == 9999
        return super().reset(seed=seed, options=options)

    def step(self, action):
        observation, *rest = super().step(action)
        return (observation * np.nan if self.is_bad and self.steps == 2 else observation, *rest)


class SlowStepEnv(WalkEnv):
    """Takes two milliseconds a step."""

    def step(self, action):
        time.sleep(0.002)
        return super().step(action)


class LateFaultEnv(WalkEnv):
    """The walk, which breaks its word in the third step of the episode of seed 9999."""

    fault = "column"

    def reset(self, *, seed=None, options=None):
        self.steps_left = 3 if seed == 9999 else 10**9
        return super().reset(seed=seed, options=options)

    def step(self, action):
        self.steps_left -= 1
        observation, reward, _, *rest = super().step(action)
        returned = [observation, reward, abs(self.place) == 5 and self.steps_left > 10, *rest]
        if self.steps_left == 0:
            place, value, _ = LATE_FAULTS[self.fault]
            returned[place] = value
        return tuple(returned)


# Which of the five values that a step returns, what it is, and what is said of it.
LATE_FAULTS = {
    "column": (
        0,
        np.zeros((2, 1), np.float32),
        r"must return observations of 2 numbers.*of shape \(2, 1\).*",
    ),
    "long": (0, np.zeros(3, np.float32), r"must return observations of 2 numbers.*of shape \(3,\).*"),
    "scalar": (0, np.float32(0), r"must return observations of 2 numbers.*of shape \(\).*"),
    "number": (0, 0.5, r"must return observations of 2 numbers.*got 0\.5, of shape \(\).*"),
    "array reward": (1, np.ones(1), r"must return a reward that is one number; got array\(\[1\.\]\)"),
    "no reward": (1, None, r"must return a reward that is one number; got None"),
    "infinite reward": (1, np.inf, r"returned a reward that is not a finite number, inf"),
    "float32 reward": (1, np.float32(-np.inf), r"returned a reward that is not a finite number, -inf"),
}
