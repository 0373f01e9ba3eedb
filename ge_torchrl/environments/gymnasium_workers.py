"""Worker processes that play episodes of a Gymnasium environment, counted and stopped while they play."""

from __future__ import annotations

import atexit
import contextlib
import math
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing.context import SpawnContext
from typing import Any, TypeVar

from ge_torchrl.environments.gymnasium_runner import Runner, Watch
from ge_torchrl.environments.sending import portable, unpack
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.environments.worker_faults import Silence, Words, worker_died
from ge_torchrl.interrupts import INTERRUPTS, held_back

_Result = TypeVar("_Result")

# How often workers count and the calling process looks [s].
_LOOK_SECONDS = 0.1
# And a worker whether it may go on [s].
_WAIT_SECONDS = 0.01
# After a stop a worker ends with its step; one that takes longer than this is left to itself [s].
_STOP_SECONDS = 10.0


def spawning() -> SpawnContext:
    """Return what starts processes anew, also within a process that joblib started.

    Such a process has a start method that no process knows which was not started by joblib too.
    """
    if multiprocessing.get_start_method() not in multiprocessing.get_all_start_methods():
        multiprocessing.set_start_method("spawn", force=True)
    return multiprocessing.get_context("spawn")


class Workers:
    """Processes with a `Runner` each. They are started by the first call and serve later ones.

    They import the main module anew, as Python's `spawn` does: a script that uses them needs the usual
    `if __name__ == "__main__":`.

    Args:
        spec: The environment.
        n_workers: Number of processes.

    Raises:
        EnvironmentFaultError: The environment cannot be sent to another process.
    """

    def __init__(self, spec: EnvironmentSpec, n_workers: int) -> None:
        self.n_workers = n_workers
        self.is_usable = True
        self._id, self._step_seconds = spec.id, spec.step_seconds
        context = spawning()
        self._board = _Board(
            context.RawArray("q", n_workers),
            context.RawArray("q", n_workers),
            context.RawValue("b", 0),
            context.RawValue("d", math.inf),
            context.Value("i", 0),
            Words.empty(context, n_workers),
        )
        self._counted = 0
        self._pool = ProcessPoolExecutor(
            n_workers, context, initializer=_start, initargs=(portable(spec), self._board)
        )

    def map(
        self, task: Callable[..., _Result], arguments: Sequence[tuple[Any, ...]], watch: Watch
    ) -> list[_Result]:
        """Return `task(runner, watch of the worker, *arguments)` for all arguments, in their order.

        Args:
            task: A function of a module.
            arguments: Of each call.
            watch: Is told of the steps of all workers while they play; may end the work.

        Raises:
            EnvironmentFaultError: The environment is at fault, or a worker died.
            LimitReachedError: The watch said so. Workers have stopped, and their steps are counted.
        """
        futures: list[Future[_Result]] = []
        self._board.most_steps.value = self._counted + watch.allowance - 1
        try:
            with held_back():
                futures = [self._pool.submit(_work, task, each) for each in arguments]
            waiting, silence = set(futures), Silence(self._board.words, self._id, self._step_seconds)
            while waiting:
                looked = time.perf_counter()
                done, waiting = wait(waiting, timeout=_LOOK_SECONDS, return_when=FIRST_EXCEPTION)
                for future in done:
                    future.result()
                watch.look(self._new_steps())
                silence.check(time.perf_counter() - looked)
            return [future.result() for future in futures]
        except BrokenProcessPool as error:
            self.is_usable = False
            raise worker_died(self._id, self._board.words) from error
        except BaseException:
            # If Ctrl-C ends the wait, or comes before it, nobody knows who still plays.
            self.is_usable = False
            self._stop(futures)
            raise
        finally:
            watch.count(self._new_steps())

    def _new_steps(self) -> int:
        total = int(sum(self._board.steps))
        new, self._counted = total - self._counted, total
        return new

    def _stop(self, futures: Sequence[Future[Any]]) -> None:
        self._board.stop.value = 1
        _, playing = wait([future for future in futures if not future.cancel()], timeout=_STOP_SECONDS)
        self.is_usable = not playing
        if self.is_usable:
            self._board.stop.value = 0

    def close(self) -> None:
        """End the processes; one that hangs in the environment is killed."""
        self._board.stop.value = 1
        if not self.is_usable:
            for process in filter(None, self._board.processes):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)
        self._pool.shutdown(cancel_futures=True)


@dataclass(frozen=True, eq=False)
class _Board:
    """What the processes share.

    Attributes:
        steps: Steps that each worker made.
        processes: Number of each worker's process.
        stop: Not 0 where work is to end.
        most_steps: Steps that all workers may make together.
        started: How many workers have taken a place.
        words: What is known of hangs.
    """

    steps: Any
    processes: Any
    stop: Any
    most_steps: Any
    started: Any
    words: Words


class _StoppedError(Exception):
    """The calling process wants no more of this."""


class _BoardWatch:
    """The watch of a worker: its steps go to the board, from where the order to stop comes.

    Where few steps are left it looks more often, so that all workers together make hardly more.
    """

    def __init__(self, board: _Board) -> None:
        self._board = board
        with board.started.get_lock():
            self._place = board.started.value
            board.started.value += 1
        board.processes[self._place] = os.getpid()
        board.words.kept(self._place)
        self.due, self.allowance = 0.0, 1.0

    def look(self, n_steps: int) -> None:
        """Count steps; see `Watch`.

        Raises:
            _StoppedError: The calling process says so.
        """
        self.count(n_steps)
        while not self._board.stop.value and self._steps_left() < 0:
            # The calling process sees that too, and says so.
            time.sleep(_WAIT_SECONDS)
        if self._board.stop.value:
            raise _StoppedError
        self.due = time.perf_counter() + _LOOK_SECONDS
        self.allowance = 1 + max(0.0, self._steps_left() // (2 * len(self._board.steps)))

    def count(self, n_steps: int) -> None:
        """Count steps; see `Watch`."""
        self._board.steps[self._place] += n_steps
        self.allowance -= n_steps

    def _steps_left(self) -> float:
        left: float = self._board.most_steps.value - sum(self._board.steps)
        return left


class _Worker:
    """What a worker process has; the runner comes with the first work, so that its faults reach the caller."""

    def __init__(self, sent: bytes, board: _Board) -> None:
        self.watch = _BoardWatch(board)
        self.sent = sent
        self.runner: Runner | None = None

    def close(self) -> None:
        """Close the environment: a simulator may have processes and files of its own."""
        runner, self.runner = self.runner, None
        if runner is not None:
            runner.close()


_worker: list[_Worker] = []


def _start(sent: bytes, board: _Board) -> None:
    # What ends a run is for the calling process, which ends its workers; without it they end too.
    for number in INTERRUPTS - {signal.SIGTERM}:
        signal.signal(number, signal.SIG_IGN)
    if hasattr(signal, "sigwaitinfo"):
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
        threading.Thread(target=_end_when_parent_says_so, daemon=True).start()
    elif hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    threading.Thread(target=_end_with_parent, daemon=True).start()
    worker = _Worker(sent, board)
    _worker.append(worker)
    atexit.register(worker.close)


def _end_when_parent_says_so() -> None:
    # A scheduler tells all processes of a job at once; `Process.terminate` means this one.
    while signal.sigwaitinfo({signal.SIGTERM}).si_pid != os.getppid():
        pass
    os._exit(1)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _work(task: Callable[..., _Result], arguments: tuple[Any, ...]) -> _Result:
    worker = _worker[0]
    worker.watch.look(0)
    if worker.runner is None:
        worker.runner = Runner(unpack(worker.sent))
    return task(worker.runner, worker.watch, *arguments)
