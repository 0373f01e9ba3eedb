"""Gymnasium environments in which something does not come back, each in one way."""

import contextlib
import ctypes
import os
import time

from environments_for_tests import CountdownEnv
from gymnasium.envs.classic_control import CartPoleEnv

HANGS_IN = 9999
"""The seed of the episode that hangs."""


def stuck(library):
    """Wait in compiled code for what nobody gives."""
    lock = ctypes.create_string_buffer(256)
    for _ in range(2):
        library.pthread_mutex_lock(lock)


class HangingEnv(CountdownEnv):
    """Hangs in the second step of an episode."""

    def reset(self, *, seed=None, options=None):
        self.seed = seed
        return super().reset(seed=seed, options=options)

    def step(self, action):
        if self.steps == 1 and self.seed == HANGS_IN:
            self.hang()
        return super().step(action)

    def hang(self):
        while True:
            time.sleep(0.01)


class DeafEnv(HangingEnv):
    """Answers Ctrl-C by going on, for a second and a half."""

    def hang(self):
        until = time.monotonic() + 1.5
        while time.monotonic() < until:
            with contextlib.suppress(KeyboardInterrupt):
                time.sleep(0.01)


class TwistingEnv(HangingEnv):
    """Makes a fault of its own of Ctrl-C."""

    def hang(self):
        try:
            super().hang()
        except KeyboardInterrupt:
            raise RuntimeError("the simulator is gone") from None


class HangingInResetEnv(CountdownEnv):
    """Hangs in reset."""

    def reset(self, *, seed=None, options=None):
        if seed == HANGS_IN:
            time.sleep(600)
        return super().reset(seed=seed, options=options)


class HangingAtTheEndEnv(CountdownEnv):
    """Hangs when it is closed a second time: one is made and closed to look at it."""

    closed = 0

    def close(self):
        type(self).closed += 1
        if self.closed == 2:
            time.sleep(600)


class HangingAsItIsMadeEnv(CountdownEnv):
    """Hangs when it is made a second time."""

    made = 0

    def __init__(self, **_):
        type(self).made += 1
        if self.made == 2:
            time.sleep(600)


class ElsewhereEnv(HangingEnv):
    """Hangs in worker processes alone: in Python, or in compiled code by what `TEST_HANGS_BY` says."""

    def step(self, action):
        if self.steps == 1 and str(os.getpid()) != os.environ["TEST_ENVIRONMENT_LIVES_IN"]:
            self.hang()
        return CountdownEnv.step(self, action)

    def hang(self):
        by = os.environ["TEST_HANGS_BY"]
        if by == "Python":
            super().hang()
        stuck(ctypes.PyDLL(None) if by == "the interpreter's lock" else ctypes.CDLL(None))


class HangingCartPoleEnv(CartPoleEnv):
    """Hangs from when on it is told to."""

    hangs = False

    def step(self, action):
        if self.hangs:
            time.sleep(600)
        return super().step(action)
