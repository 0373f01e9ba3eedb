"""The one count of environment steps, with the limit on them and the sign of life."""

from __future__ import annotations

import math
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal, Protocol

# A sign of life is given at most this often [s].
_BEAT_SECONDS = 0.25


@dataclass(frozen=True)
class Limit:
    """How far a run may go.

    Attributes:
        deadline: The moment on the clock of `time.perf_counter` [s].
        max_env_steps: Environment steps of all purposes together; None for no limit.
        utmost: How far it may go for what it cannot do without; None for any.
    """

    deadline: float = math.inf
    max_env_steps: int | None = None
    utmost: Limit | None = None

    def part(self, share: float, done: int) -> Limit:
        """Return how far somebody may go who may take a part of what is left.

        Args:
            share: The part, from 0 to 1.
            done: Environment steps until now.
        """
        now, most = time.perf_counter(), self.max_env_steps
        return Limit(
            now + share * (self.deadline - now),
            None if most is None else done + int(share * (most - done)),
            self.utmost,
        )


class Limited(Protocol):
    """Who has steps and a limit on them."""

    @property
    def steps(self) -> Counter[str]:
        """Environment steps by purpose."""
        ...

    limit: Limit | None


@contextmanager
def within(limited: Limited, share: float) -> Iterator[None]:
    """Leave somebody a part of what its limit leaves, for as long as this lasts.

    Args:
        limited: It may have no limit.
        share: The part, from 0 to 1.
    """
    limit = limited.limit
    if limit is not None:
        limited.limit = limit.part(share, limited.steps.total())
    try:
        yield
    finally:
        limited.limit = limit


class LimitReachedError(Exception):
    """A run has come to its limit: not a fault, but the end of what it may do.

    Attributes:
        reason: The setting that says so.
    """

    def __init__(self, reason: Literal["max_seconds", "max_env_steps"]) -> None:
        super().__init__(f"ge.{reason} is reached")
        self.reason = reason


class Ledger:
    """The one count of environment steps, with the limit on them and the sign of life.

    It may be written from any thread. Signs of life are given in the thread that made the ledger.

    Attributes:
        steps: Environment steps by purpose.
        timed: By purpose, of the calls that ran trees from their first step to their last: their steps, and the clock
            time that they took [s].
        limit: How far the run may go; None for no limit.
        on_steps: Called with the number of all steps so far, every second or more often while steps are made.
    """

    def __init__(self) -> None:
        self.steps: Counter[str] = Counter()
        self.timed: dict[str, tuple[int, float]] = {}
        self.limit: Limit | None = None
        self.on_steps: Callable[[int], None] = _say_nothing
        self._lock = threading.Lock()
        self._thread = threading.get_ident()
        self._last_beat = -math.inf

    def check(self) -> None:
        """Say that the run goes on.

        Raises:
            LimitReachedError: It may not.
        """
        limit = self.limit
        if limit is not None:
            if time.perf_counter() >= limit.deadline:
                raise LimitReachedError("max_seconds")
            if limit.max_env_steps is not None and self.steps.total() >= limit.max_env_steps:
                raise LimitReachedError("max_env_steps")
        self.beat()

    def count(self, purpose: str, n_steps: int) -> None:
        """Add steps that were made."""
        if n_steps > 0:
            with self._lock:
                self.steps[purpose] += n_steps
        self.beat()

    @contextmanager
    def timing(self, purpose: str) -> Iterator[None]:
        """Time the steps that are made meanwhile; calls of one purpose are timed one after another."""
        started, before = time.perf_counter(), self.steps[purpose]
        yield
        steps, seconds = self.timed.get(purpose, (0, 0.0))
        made, took = self.steps[purpose] - before, time.perf_counter() - started
        self.timed[purpose] = (steps + made, seconds + took)

    def beat(self) -> None:
        """Give a sign of life where one is due."""
        now = time.perf_counter()
        if now - self._last_beat >= _BEAT_SECONDS and threading.get_ident() == self._thread:
            self._last_beat = now
            self.on_steps(self.steps.total())

    @property
    def steps_left(self) -> float:
        """Steps until `max_env_steps`, infinite without one."""
        if self.limit is None or self.limit.max_env_steps is None:
            return math.inf
        return self.limit.max_env_steps - self.steps.total()


def _say_nothing(_n_steps: int) -> None:
    pass


class Accountable:
    """What has a ledger, and shows its parts as its own.

    Args:
        ledger: Another's, where the steps are counted together; None for a new one.
    """

    def __init__(self, ledger: Ledger | None = None) -> None:
        self.ledger = Ledger() if ledger is None else ledger

    @property
    def steps(self) -> Counter[str]:
        """Environment steps by purpose."""
        return self.ledger.steps

    @property
    def limit(self) -> Limit | None:
        """How far the run may go."""
        return self.ledger.limit

    @limit.setter
    def limit(self, limit: Limit | None) -> None:
        self.ledger.limit = limit

    @property
    def on_steps(self) -> Callable[[int], None]:
        """What is called with the number of all steps so far, as a sign of life."""
        return self.ledger.on_steps

    @on_steps.setter
    def on_steps(self, on_steps: Callable[[int], None]) -> None:
        self.ledger.on_steps = on_steps
