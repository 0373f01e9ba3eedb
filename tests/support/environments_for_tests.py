"""Small well-behaved Gymnasium environments that do one thing."""

import itertools
import os
import time
from pathlib import Path

import gymnasium as gym
import numpy as np


class CountdownEnv(gym.Env):
    """Ends after three steps, pays the number of the action; the actions are 5 and 6."""

    observation_space = gym.spaces.Box(-1, 1, (2,), np.float32)
    action_space = gym.spaces.Discrete(2, start=5)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed, options=options)
        self.steps = 0
        return np.zeros(2, np.float32), {}

    def step(self, action):
        self.steps += 1
        return np.zeros(2, np.float32), float(action), self.steps == 3, False, {}


class WalkEnv(gym.Env):
    """A random walk over whole numbers from -5 to 5, which the seed and the action steer; pays its place.

    Subclasses observe it in other types. The walk ends at its ends.
    """

    observation_space = gym.spaces.Box(-5, 5, (2,), np.float32)
    action_space = gym.spaces.Discrete(2)
    dtype = np.float32

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed, options=options)
        self.place = int(self.np_random.integers(-2, 3))
        return self.observe(), {}

    def step(self, action):
        assert action in {0, 1}
        self.place += 1 if self.np_random.random() < 0.3 + 0.4 * action else -1
        return self.observe(), float(self.place), abs(self.place) == 5, False, {}

    def observe(self):
        return np.array([self.place, self.place % 2]).astype(self.dtype)


class Float64WalkEnv(WalkEnv):
    """Observes the walk in float64."""

    observation_space = gym.spaces.Box(-5, 5, (2,), np.float64)
    dtype = np.float64


class Int64WalkEnv(WalkEnv):
    """Observes the walk in int64."""

    observation_space = gym.spaces.Box(-5, 5, (2,), np.int64)
    dtype = np.int64


class UInt8WalkEnv(WalkEnv):
    """Observes the walk in uint8, counted from 0."""

    observation_space = gym.spaces.Box(0, 10, (2,), np.uint8)
    dtype = np.uint8

    def observe(self):
        return np.array([self.place + 5, self.place % 2], np.uint8)


class BoolWalkEnv(WalkEnv):
    """Observes whether the place is right of the middle, and whether it is odd."""

    observation_space = gym.spaces.Box(0, 1, (2,), np.bool_)

    def observe(self):
        return np.array([self.place > 0, self.place % 2 == 1])


class FromOneEnv(WalkEnv):
    """The walk with actions 1 and 2."""

    action_space = gym.spaces.Discrete(2, start=1)

    def step(self, action):
        return super().step(action - 1)


class CountingEnv(WalkEnv):
    """The walk, which counts the steps of all its copies in this process."""

    steps_made = 0

    def step(self, action):
        type(self).steps_made += 1
        return super().step(action)


class EndlessEnv(CountdownEnv):
    """Never ends."""

    def step(self, action):
        observation, reward, _, *rest = super().step(action)
        return (observation, reward, False, *rest)


class SlowEnv(EndlessEnv):
    """Takes two milliseconds a step, and never ends."""

    def step(self, action):
        time.sleep(0.002)
        return super().step(action)


class TakingEnv(WalkEnv):
    """The walk without ends, alike on both sides, whose steps take as long as they are told to."""

    seconds = 0.0

    def step(self, action):
        time.sleep(self.seconds)
        observation, _, _, *rest = super().step(action)
        self.place = max(-4, min(4, self.place))
        return (observation, float(abs(self.place)), False, *rest)


class PicturesEnv(CountdownEnv):
    """Observes a matrix, which a tree cannot split."""

    observation_space = gym.spaces.Box(-1, 1, (2, 2), np.float32)


class SwitchesEnv(CountdownEnv):
    """Takes several switches at once, which a leaf cannot hold."""

    action_space = gym.spaces.MultiBinary(3)


class UnseededEnv(WalkEnv):
    """The walk, which begins and goes on as it likes, whatever the seed; no two of its states are alike."""

    def reset(self, *, seed=None, options=None):  # noqa: ARG002
        return super().reset(options=options)

    def observe(self):
        return (0.9 * super().observe() + 0.1 * self.np_random.random(2)).astype(self.dtype)


class BreakoutEnv(CountdownEnv):
    """Counts its steps to 40 in x0, within bounds that say nothing, and twice them in x1, beyond those it declares."""

    observation_space = gym.spaces.Box(np.float32([-1e9, -1]), np.float32([1e9, 1]))

    def step(self, action):
        super().step(action)
        return np.array([self.steps, 2 * self.steps], np.float32), 1.0, self.steps == 40, False, {}


class StillEnv(BreakoutEnv):
    """Its x1 never varies, whatever it declares."""

    def step(self, action):
        observation, *rest = super().step(action)
        observation[1] = 0
        return (observation, *rest)

    observation_space = gym.spaces.Box(-1e9, 1e9, (2,), np.float32)


class SpacesEnv(gym.Env):
    """Observes and takes whatever its spaces hold; ends after three steps, and keeps its actions."""

    def __init__(self, observed=None, taken=None):
        self.observation_space = observed or gym.spaces.Box(-1, 1, (2,), np.float32)
        self.action_space = taken or gym.spaces.Discrete(2)
        self.taken = []

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed, options=options)
        self.observation_space.seed(seed)
        self.taken = []
        return self.observation_space.sample(), {}

    def step(self, action):
        assert self.action_space.contains(action), action
        self.taken.append(action)
        return self.observation_space.sample(), 1.0, len(self.taken) == 3, False, {}


class ThrustEnv(CountdownEnv):
    """Takes two numbers, pays their sum; one of them has no upper bound, and the other no lower one."""

    action_space = gym.spaces.Box(np.array([0, -1e300]), np.array([np.inf, 0.5]), dtype=np.float64)

    def step(self, action):
        return super().step(float(np.sum(action)))


class EchoEnv(gym.Env):
    """Observes four random numbers, keeps what it is given, and changes it; three steps of two numbers each."""

    observation_space = gym.spaces.Box(-np.inf, np.inf, (4,), np.float32)
    action_space = gym.spaces.Box(np.float32([-1, -np.inf]), np.float32([0.3, 2]))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed, options=options)
        self.given = []
        return self.observe(), {}

    def step(self, action):
        assert (type(action), action.dtype, action.shape) == (np.ndarray, self.action_space.dtype, (2,))
        assert self.action_space.contains(action)
        self.given.append(action.copy())
        action[:] = 7
        return self.observe(), 0.0, len(self.given) == 3, False, {}

    def observe(self):
        return (self.np_random.normal(size=4) * 10.0 ** self.np_random.integers(-3, 4)).astype(np.float32)


class Float64EchoEnv(EchoEnv):
    """Takes float64."""

    action_space = gym.spaces.Box(np.array([-1, -2]), np.array([0.3, np.inf]), dtype=np.float64)


class ClosingEnv(CountdownEnv):
    """Leaves a file in a folder when it is closed."""

    def close(self):
        (Path(os.environ["TEST_CLOSED_IN"]) / str(os.getpid())).touch()


class DoubledReward(gym.Wrapper):
    """Pays twice."""

    def step(self, action):
        observation, reward, *rest = self.env.step(action)
        return (observation, 2 * reward, *rest)


def register(kind, **arguments):
    """Register a class of environments under a name of its own, once; return its id.

    Another class of the same name gets another id: what is known of one holds for one.
    """
    for number in itertools.count(1):
        environment_id = f"Test{kind.__name__}{number if number > 1 else ''}-v0"
        known = gym.registry.get(environment_id)
        if known is None:
            gym.register(environment_id, entry_point=kind, **arguments)
        if known is None or known.entry_point is kind:
            return environment_id
    raise AssertionError("numbers do not end")


def register_plugin():
    """Register an environment, as the entry point of a package does."""
    gym.register("Plugged/Walk-v0", entry_point=WalkEnv)
