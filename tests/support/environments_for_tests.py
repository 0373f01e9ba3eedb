"""Small Gymnasium environments that do one thing, good or bad."""

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


class RaisingEnv(CountdownEnv):
    """Raises in its third step."""

    def step(self, action):
        if self.steps == 2:
            raise RuntimeError("the motor is on fire")
        return super().step(action)


class NaNEnv(CountdownEnv):
    """Observes NaN after its second step."""

    def step(self, action):
        observation, *rest = super().step(action)
        return (observation * np.nan if self.steps == 2 else observation, *rest)


class NaNRewardEnv(CountdownEnv):
    """Pays NaN in its first step."""

    def step(self, action):
        observation, _, *rest = super().step(action)
        return (observation, float("nan"), *rest)


class EndlessEnv(CountdownEnv):
    """Never ends."""

    def step(self, action):
        observation, reward, _, *rest = super().step(action)
        return (observation, reward, False, *rest)


class PicturesEnv(CountdownEnv):
    """Observes a matrix, which a tree cannot split."""

    observation_space = gym.spaces.Box(-1, 1, (2, 2), np.float32)


class ContinuousEnv(CountdownEnv):
    """Takes a continuous action, which a leaf cannot hold."""

    action_space = gym.spaces.Box(-1, 1, (1,), np.float32)
