"""Steps that do not come back: a call that takes longer than it may is interrupted, and told with its place.

A thread looks once a second at what the others are in the middle of. What is looked at pays nothing for that; to read a
clock in each step would cost CartPole a fiftieth.
"""

from __future__ import annotations

import sys
import threading
import time
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
        thread: It looks.
        beat: Is called at each look.
        give_up: Ends the process of a call that cannot be interrupted, and tells what it was.
    """

    methods: set[CodeType] = set()  # noqa: RUF012 (there is one watch in a process)
    thread: threading.Thread | None = None
    beat: Callable[[], object] = lambda: None
    give_up: Callable[[str], object] = end_hung


def watch(*methods: Callable[..., object]) -> None:
    """Interrupt calls of these methods of a `Stepped` that take too long; it may be said again."""
    _Watch.methods.update(method.__code__ for method in methods)
    # A fork takes no thread along.
    if _Watch.thread is None or not _Watch.thread.is_alive():
        _Watch.thread = threading.Thread(target=_look_on, name="watch of steps", daemon=True)
        _Watch.thread.start()


def watch_as_worker(beat: Callable[[], object], give_up: Callable[[str], object]) -> None:
    """Let this process be a worker, which tells another one.

    Args:
        beat: Is called every second, while anything of Python runs here.
        give_up: Is told what has not come back, where that cannot be interrupted; ends the process.
    """
    _Watch.beat, _Watch.give_up = beat, give_up
    watch()


def _look_on() -> None:
    looks = Looks()
    while True:
        time.sleep(_LOOK_SECONDS)
        _Watch.beat()
        looks.look(_LOOK_SECONDS)


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
