"""Kernels on threads: short tasks in their order, with the limit held and a sign of life between them."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

from ge_torchrl.environments.backend import Ledger

_Result = TypeVar("_Result")

# How long the calling thread waits before it gives a sign of life [s].
_PATIENCE = 0.25


@dataclass(frozen=True)
class Task:
    """A short piece of work.

    Attributes:
        run: Does it and returns the number of environment steps.
        most_steps: How many these are at most.
    """

    run: Callable[[], int]
    most_steps: int


class Threads:
    """Runs work side by side.

    Args:
        n: Number of threads, at least 1; with one, work is done in the calling thread.
        ledger: Where steps are counted.
    """

    def __init__(self, n: int, ledger: Ledger) -> None:
        self.n = n
        self._ledger = ledger
        self._pool = ThreadPoolExecutor(n) if n > 1 else None

    def run(self, tasks: Iterable[Task], purpose: str) -> None:
        """Run tasks and count their steps.

        A task begins where the tasks in front of it leave steps to make, however many threads there are: so the
        ledger says the same when the limit ends the run.

        Raises:
            LimitReachedError: The limit was reached before the last task began.
        """
        running: deque[tuple[Future[int], int]] = deque()
        try:
            for task in tasks:
                # Close to the limit a task waits until it is known how many steps were made.
                while running and (
                    len(running) >= 2 * self.n or sum(most for _, most in running) >= self._ledger.steps_left
                ):
                    self._collect(running, purpose)
                self._ledger.check()
                if self._pool is None:
                    self._ledger.count(purpose, task.run())
                else:
                    running.append((self._pool.submit(task.run), task.most_steps))
            while running:
                self._collect(running, purpose)
        except BaseException:
            for future, _ in running:
                if not future.cancel() and future.exception() is None:
                    self._ledger.count(purpose, future.result())
            raise

    def _collect(self, running: deque[tuple[Future[int], int]], purpose: str) -> None:
        future, _ = running.popleft()
        self._ledger.count(purpose, self._result(future))

    def _result(self, future: Future[_Result]) -> _Result:
        while not wait([future], _PATIENCE).done:
            self._ledger.beat()
        return future.result()

    def each(self, functions: Sequence[Callable[[], _Result]]) -> list[_Result]:
        """Return the results of functions that count their own steps, or have none."""
        if self._pool is None or len(functions) == 1:
            return [function() for function in functions]
        futures = [self._pool.submit(function) for function in functions]
        try:
            while wait(futures, _PATIENCE, FIRST_EXCEPTION).not_done:
                if any(future.done() and future.exception() is not None for future in futures):
                    break
                self._ledger.beat()
            return [self._result(future) for future in futures]
        finally:
            for future in futures:
                future.cancel()

    def close(self) -> None:
        """Release the threads."""
        if self._pool is not None:
            self._pool.shutdown()


@contextmanager
def quick_switches() -> Iterator[None]:
    """Let Python's threads take turns every half a millisecond.

    Jobs go back and forth between Python and kernels of a millisecond, which run without the interpreter's lock; at
    Python's own 5 ms a thread would mostly wait for it.
    """
    interval = sys.getswitchinterval()
    sys.setswitchinterval(5e-4)
    try:
        yield
    finally:
        sys.setswitchinterval(interval)
