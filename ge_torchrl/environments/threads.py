"""Kernels on threads: tasks in their order, with the limit held and a sign of life between them."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass

from ge_torchrl.environments.ledger import Ledger, Limit

# How long the calling thread waits for others before it gives a sign of life [s].
_PATIENCE = 0.25
# Waking a thread costs as long as some thousands of steps.
_STEPS_WORTH_THREADS = 20_000


@dataclass(frozen=True)
class Task:
    """A piece of work.

    Attributes:
        run: Does it and returns the number of environment steps that are still to be counted.
        most_steps: How many these are at most.
    """

    run: Callable[[], int]
    most_steps: int = 0


class Threads:
    """Runs tasks side by side: the calling thread and its helpers take them one after another.

    Args:
        n: Number of threads, at least 1, with the calling one.
        ledger: Where steps are counted.
    """

    def __init__(self, n: int, ledger: Ledger) -> None:
        self.n = n
        self._ledger = ledger
        self._pool = ThreadPoolExecutor(n - 1) if n > 1 else None

    def run(self, tasks: Iterable[Task], purpose: str, most_steps: float = float("inf")) -> None:
        """Run tasks and count their steps.

        A task begins where the tasks in front of it leave steps to make, however many threads there are: so the
        ledger says the same when a limit of steps ends the run.

        Args:
            tasks: What is to be done.
            purpose: Under which steps are counted.
            most_steps: How many steps all tasks make at most; for few of them no helper is called.

        Raises:
            LimitReachedError: The limit was reached before the last task began.
        """
        self._ledger.check()
        shared = _Shared(tasks, purpose, self._ledger)
        helpers: list[Future[None]] = []
        if self._pool is not None and most_steps >= _STEPS_WORTH_THREADS:
            helpers = [self._pool.submit(shared.work) for _ in range(self.n - 1)]
        try:
            shared.work()
            running = [helper for helper in helpers if not helper.cancel()]
            with self._hurried(shared.error is not None):
                while wait(running, _PATIENCE).not_done:
                    self._ledger.beat()
        except BaseException as error:
            # Ctrl-C, say: helpers end with their present task.
            shared.error = error
            raise
        if shared.error is not None:
            raise shared.error

    @contextmanager
    def _hurried(self, hurry: bool) -> Iterator[None]:
        """Let jobs of the helpers end at their next call of a backend, since nobody will read their results."""
        limit = self._ledger.limit
        if hurry:
            self._ledger.limit = Limit(deadline=float("-inf"))
        try:
            yield
        finally:
            self._ledger.limit = limit

    def close(self) -> None:
        """Release the threads, without waiting for one that may never come back from a user's own dynamics."""
        if self._pool is not None:
            self._pool.shutdown(wait=False)


class _Shared:
    """Tasks that several threads take from.

    Attributes:
        error: What ended the work before its end.
    """

    def __init__(self, tasks: Iterable[Task], purpose: str, ledger: Ledger) -> None:
        self._tasks = iter(tasks)
        self._purpose = purpose
        self._ledger = ledger
        self._changed = threading.Condition()
        self._most_running = 0
        self._ahead: Task | None = None
        self.error: BaseException | None = None

    def work(self) -> None:
        """Take tasks and do them until there is none, or an error."""
        while (task := self._take()) is not None:
            n_steps = 0
            try:
                n_steps = task.run()
            except BaseException as error:  # noqa: BLE001 - the calling thread raises it
                self.error = self.error or error
            with self._changed:
                self._most_running -= task.most_steps
                self._ledger.count(self._purpose, n_steps)
                self._changed.notify_all()

    def _take(self) -> Task | None:
        with self._changed:
            # Close to the limit a task waits until it is known how many steps the others made.
            while self._may_go_too_far():
                self._changed.wait()
            if self.error is not None or self._ahead is None:
                return None
            try:
                self._ledger.check()
            except Exception as error:  # noqa: BLE001
                self.error = error
                return None
            task, self._ahead = self._ahead, None
            self._most_running += task.most_steps
            return task

    def _may_go_too_far(self) -> bool:
        """Tell whether the next task beside those that run might make more steps than there are."""
        if self._ahead is None and self.error is None:
            self._ahead = next(self._tasks, None)
        next_steps = 0 if self._ahead is None else self._ahead.most_steps
        return self._most_running > 0 and self._most_running + next_steps > self._ledger.steps_left


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
