"""A word to whoever waits."""

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from ge_torchrl.cli.statuses import USER_ERROR
from ge_torchrl.interrupts import Stepping, leave_now

_SILENCE_SECONDS = 1.5
# Fewer tell nothing of how long the others take: the first one waits for what is loaded for all.
_FEWEST = 5
# How far something is is told so often at least.
_LONGEST_SILENCE_SECONDS = 60.0
# A compiled step that takes longer does not return [s].
_STEP_SECONDS = 20.0


@contextmanager
def looked_at(environment_id: str) -> Iterator[None]:
    """Say on standard error what is being looked at, once that takes longer than a person waits without a word.

    Where a step of a user's own dynamics does not return meanwhile, that is said and the program ends: nothing can
    interrupt compiled code.
    """
    seen = threading.Event()

    def watch() -> None:
        if seen.wait(_SILENCE_SECONDS):
            return
        print(f"ge-torchrl: looking at {environment_id} ...", file=sys.stderr, flush=True)
        while not seen.wait(_SILENCE_SECONDS):
            if time.perf_counter() - Stepping.since > _STEP_SECONDS:
                leave_now(
                    USER_ERROR,
                    f"env.dynamics={environment_id} must return from every step; one has not in "
                    f"{_STEP_SECONDS:.0f} s: look for a loop in it that may not end",
                )

    threading.Thread(target=watch, daemon=True).start()
    try:
        yield
    finally:
        seen.set()


class HowFar:
    """Says on standard error how far something is, once that takes longer than a person waits, and ever more rarely.

    Args:
        things: What is counted, such as "episodes".
    """

    def __init__(self, things: str) -> None:
        self._things = things
        self._begin(0)

    def _begin(self, done: int) -> None:
        self._first = self._done = done
        self._started, self._next = time.perf_counter(), _SILENCE_SECONDS

    def __call__(self, done: int, in_all: int) -> None:
        """Say how many are done, where that is due; fewer than before are those of something else.

        Args:
            done: How many are done, at least 1.
            in_all: How many there are.
        """
        if done <= self._done:
            self._begin(done)
        self._done = done
        elapsed = time.perf_counter() - self._started
        if elapsed < self._next or done == in_all:
            return
        from ge_torchrl.report.html.figures import seconds

        counted = done - self._first
        left = f", {seconds(elapsed * (in_all - done) / counted)} left" if counted >= _FEWEST else ""
        print(f"ge-torchrl: {done:,} of {in_all:,} {self._things}{left}", file=sys.stderr, flush=True)
        self._next = min(2 * elapsed, elapsed + _LONGEST_SILENCE_SECONDS)
