"""A clock that a test owns, so that what it says of seconds holds on a busy machine too."""

import time
from contextlib import contextmanager
from unittest import mock


class OwnClock:
    """Counts what this process computes, and takes every sleep as slept at once.

    The work of other processes does not make it go on. Several threads make it go as many times as fast.
    """

    def __init__(self):
        self.slept = 0.0

    def read(self):
        return time.process_time() + self.slept

    def sleep(self, seconds):
        self.slept += seconds

    @contextmanager
    def ticking(self):
        """Let it be the clock of all that is called."""
        with mock.patch.multiple(time, perf_counter=self.read, sleep=self.sleep):
            yield self
