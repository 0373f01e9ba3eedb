"""The walk as an environment of whole runs: one that counts its steps, and one whose steps are dear."""

import time
from collections import Counter
from contextlib import contextmanager
from typing import ClassVar

import gymnasium as gym
from environments_for_tests import WalkEnv

BNF = """
<if>    ::= if lt(x0, <place>) then <then> else <then>
<then>  ::= a0 | a1 | <if>
<place> ::= [-4, 4] step 0.5
"""


class CountingWalkEnv(WalkEnv):
    """Counts all steps that are made in it."""

    made: ClassVar = Counter()

    def step(self, action):
        self.made["steps"] += 1
        return super().step(action)


class SlowWalkEnv(CountingWalkEnv):
    """Makes about a thousand steps a second, and no episode of less than a hundred steps."""

    seconds = 0.001

    def step(self, action):
        time.sleep(self.seconds)
        observation, reward, _, *rest = super().step(action)
        self.place = max(-4, min(4, self.place))
        return (observation, reward, False, *rest)


@contextmanager
def registered(environment, max_episode_steps=None):
    """Let Gymnasium know an environment for a while; yields the section of its configuration."""
    gym.register("Walk-v0", entry_point=environment, max_episode_steps=max_episode_steps)
    names = {"features": [], "units": [], "actions": [], "solved_at": None}
    try:
        yield {"id": "Walk-v0", "route": "gymnasium", "workers": 1, **names}
    finally:
        del gym.registry["Walk-v0"]
