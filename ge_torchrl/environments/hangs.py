"""Steps that do not come back: a call that takes longer than it may is interrupted, and told with its place.

A thread looks once a second at what the others are in the middle of. What is looked at pays nothing for that; to read a
clock in each step would cost CartPole a fiftieth.
"""

from __future__ import annotations

import sys
import threading
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from types import CodeType, FrameType
from typing import Protocol

from ge_torchrl.interrupts import end_hung, interrupt

LONGEST_STEP_SECONDS = 300.0
"""How long a step or a reset may take, where nobody says [s]."""
GRACE_SECONDS = 5.0
"""What is interrupted has so long to notice [s]."""
# How often one looks [s].
_LOOK_SECONDS = 1.0


class Stepped(Protocol):
    """Who calls an environment, by the methods that are watched.

    Attributes:
        step_seconds: How long a call may take [s].
        is_hung: Whether one took longer, so that it was interrupted.
    """

    step_seconds: float
    is_hung: bool

    def told_of_hang(self) -> str:
        """Return in one line what has not come back."""
        ...


class _Watch:
    """What is watched in this process, and what is done about it.

    Attributes:
        methods: Code of methods of a `Stepped`.
        stepped: Whose calls are watched.
        thread: It looks, as long as there is anything to look at; None where there is not.
        lock: Of the thread's beginning and end.
        beat: Is called at each look; None where nobody wants to know.
        give_up: Ends the process of a call that cannot be interrupted, and tells what it was.
    """

    methods: set[CodeType] = set()  # noqa: RUF012 (there is one watch in a process)
    stepped: weakref.WeakSet[Stepped] = weakref.WeakSet()  # noqa: RUF012
    thread: threading.Thread | None = None
    lock = threading.Lock()
    beat: Callable[[], object] | None = None
    give_up: Callable[[str], object] = end_hung


def watch(stepped: Stepped, *methods: Callable[..., object]) -> None:
    """Interrupt calls of these methods that take too long, until `unwatch`, or until nobody holds it any more."""
    _Watch.methods.update(method.__code__ for method in methods)
    _Watch.stepped.add(stepped)
    _begin()


def unwatch(stepped: Stepped) -> None:
    """Look at it no more; a process in which nothing is left to look at runs no thread for that."""
    _Watch.stepped.discard(stepped)


def watch_as_worker(beat: Callable[[], object], give_up: Callable[[str], object]) -> None:
    """Let this process be a worker, which tells another one.

    Args:
        beat: Is called every second, while anything of Python runs here.
        give_up: Is told what has not come back, where that cannot be interrupted; ends the process.
    """
    _Watch.beat, _Watch.give_up = beat, give_up
    _begin()


def _begin() -> None:
    with _Watch.lock:
        # A fork takes no thread along.
        if _Watch.thread is None or not _Watch.thread.is_alive():
            _Watch.thread = threading.Thread(target=_look_on, name="watch of steps", daemon=True)
            _Watch.thread.start()


def _look_on() -> None:
    looks, never = Looks(), threading.Event()
    while True:
        never.wait(_LOOK_SECONDS)
        if _Watch.beat is not None:
            _Watch.beat()
        looks.look(_LOOK_SECONDS)
        with _Watch.lock:
            if _Watch.beat is None and not _Watch.stepped:
                _Watch.thread = None
                return


@dataclass(eq=False)
class _Call:
    """A call that is on its way: whose, and for how long as far as was seen [s]."""

    stepped: Stepped
    seconds: float = 0.0


class Looks:
    """What was seen of the calls that are on their way, look by look."""

    def __init__(self) -> None:
        self._calls: dict[FrameType, _Call] = {}

    def look(self, seconds: float) -> None:
        """Look, and interrupt what takes too long.

        Args:
            seconds: Since the last look. A clock would count the time too in which the whole process was stopped.
        """
        on_their_way, before = _calls(), self._calls
        self._calls = {}
        for frame in on_their_way:
            if call := before.pop(frame, None):
                call.seconds += seconds
            elif stepped := frame.f_locals.get("self"):
                call = _Call(stepped)
            else:
                continue
            self._calls[frame] = call
        for call in before.values():
            # It came back late, and by itself.
            call.stepped.is_hung = False
        for frame, call in self._calls.items():
            self._judge(call, on_their_way[frame])

    @staticmethod
    def _judge(call: _Call, thread: int) -> None:
        stepped = call.stepped
        if call.seconds >= stepped.step_seconds and not stepped.is_hung:
            stepped.is_hung = True
            interrupt(thread, stepped.told_of_hang())
        elif call.seconds >= stepped.step_seconds + GRACE_SECONDS:
            _Watch.give_up(stepped.told_of_hang())


def _calls() -> dict[FrameType, int]:
    """Return the calls that all threads are in the middle of, of what is watched, each with its thread."""
    found: dict[FrameType, int] = {}
    for thread, innermost in sys._current_frames().items():  # noqa: SLF001 (there is no other way)
        frame: FrameType | None = innermost
        while frame is not None:
            if frame.f_code in _Watch.methods:
                found[frame] = thread
            frame = frame.f_back
    return found
