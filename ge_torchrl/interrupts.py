"""Ctrl-C at both ends of the program, where Python would answer with a traceback, and while processes are started."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

# Whether the process is this program's own.
_ours: list[bool] = []


def leave_quietly() -> None:
    """Let Ctrl-C end this process at once with status 130, until `interrupt_again`."""
    _ours.append(True)
    signal.signal(signal.SIGINT, _leave)


def interrupt_again() -> None:
    """Let Ctrl-C raise `KeyboardInterrupt` again where `leave_quietly` was called; elsewhere nothing changes."""
    if signal.getsignal(signal.SIGINT) is _leave:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def ignore_interrupts() -> None:
    """Let the program end in peace: Ctrl-C changes nothing any more, where `leave_quietly` was called."""
    if _ours:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def held_back() -> Iterator[None]:
    """Keep Ctrl-C until the end of this; processes that are started meanwhile do not hear it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _leave(_signal: int, _frame: FrameType | None) -> NoReturn:
    os._exit(130)
