"""Ctrl-C, where Python would answer with a traceback or not at all; and what else interrupts a thread.

That is at both ends of the program, while processes are started, and while compiled code runs, which Python cannot
interrupt. SIGTERM, as a scheduler sends it, and SIGHUP, which tells that the terminal is gone, are answered likewise.
"""

from __future__ import annotations

import ctypes
import logging
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import NoReturn

# What ends a run; Windows has no hangup.
INTERRUPTS = frozenset(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
_logger = logging.getLogger(__name__)
# The status of what a user can mend; `cli.statuses` is a floor above.
_USER_ERROR = 2
# Whether the process is this program's own.
_ours: list[bool] = []
# After Ctrl-C the main thread has so long to hear of it [s]. A kernel's chunk takes a tenth of a second.
_PATIENCE = 2.0
# So often one looks whether it did [s].
_LOOK = 0.1
# What is saved when it does not hear may take so long [s].
_SAVING = 5.0
# After its end the program has so long to leave [s]: a thread may never come back from compiled code.
_LEAVING = 3.0
# Standard streams that were a terminal when the program began.
_terminals: list[int] = []
# Functions that save what there is, and say what that is.
_last_words: list[Callable[[], str]] = []


class Stepping:
    """Since when a step of a user's own dynamics is on its way.

    Attributes:
        since: By `time.perf_counter`; infinite while there is none.
    """

    since = math.inf


class _Unbroken:
    """How deep the main thread is in what no exception may break off, and whether it is interrupted there."""

    depth = 0
    is_interrupted = False


class _Heard:
    """What the main thread heard.

    Attributes:
        at: When it last heard of Ctrl-C, by `time.monotonic`.
        hung: What made the program interrupt itself, in one line; None where a person or a scheduler does.
        warned: What was warned of last, likewise.
    """

    at = -math.inf
    hung: str | None = None
    warned: str | None = None


def leave_quietly() -> None:
    """Let Ctrl-C end this process at once with status 130, until `interrupt_again`."""
    _ours.append(True)
    for number in INTERRUPTS:
        # Who starts a program by nohup wants no hangup.
        if number == signal.SIGINT or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _leave)


def interrupt_again() -> None:
    """Let Ctrl-C raise `KeyboardInterrupt` again where `leave_quietly` was called; elsewhere nothing changes.

    Where the main thread does not hear of it, being in compiled code that does not return, the process ends a few
    seconds later, with what `last_words` saves.
    """
    if signal.getsignal(signal.SIGINT) is not _leave:
        return
    heard = [number for number in INTERRUPTS if signal.getsignal(number) is _leave]
    sys.unraisablehook = _unraisable
    _terminals[:] = [descriptor for descriptor in range(3) if os.isatty(descriptor)]
    if not hasattr(signal, "pthread_sigmask"):
        for number in heard:
            signal.signal(number, _interrupt)
        return
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with held_back():
        # Ctrl-C is for the main thread: this one is started deaf to it.
        threading.Thread(target=_end_what_hears_nothing, args=(reading,), daemon=True).start()
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    for number in heard:
        signal.signal(number, _interrupt)


def ignore_interrupts() -> None:
    """Let the program end in peace: Ctrl-C changes nothing any more, where `leave_quietly` was called."""
    if _ours:
        for number in INTERRUPTS:
            signal.signal(number, signal.SIG_IGN)


def leave_soon(status: int) -> int:
    """Return an exit status; if the process has not ended by itself some seconds later, it ends with that status."""
    leaving = threading.Timer(_LEAVING, leave_now, [status])
    leaving.daemon = True
    leaving.start()
    return status


def leave_now(status: int, told: str = "") -> NoReturn:
    """End the process, whatever its threads do.

    Args:
        status: Of the exit.
        told: Why, for standard error.
    """
    with suppress(OSError, ValueError):
        sys.stdout.flush()
    if told:
        print(f"ge-torchrl: {told}", file=sys.stderr, flush=True)
    os._exit(status)


@contextmanager
def last_words(save: Callable[[], str]) -> Iterator[None]:
    """Call a function where Ctrl-C finds the main thread in code that does not return, for as long as this lasts.

    Args:
        save: Saves what there is, and returns what is to be said of it.
    """
    _last_words.append(save)
    try:
        yield
    finally:
        _last_words.remove(save)


def begin_unbroken() -> None:
    """Begin what an exception would leave half made, such as a compiler's work, in the main thread.

    Where there is something to save, Ctrl-C is heard at its end; else the program ends at once.
    """
    if threading.current_thread() is threading.main_thread():
        _Unbroken.depth += 1


def end_unbroken() -> None:
    """End it.

    Raises:
        KeyboardInterrupt: It came meanwhile.
    """
    if threading.current_thread() is threading.main_thread():
        _Unbroken.depth -= 1
        if _Unbroken.is_interrupted and _Unbroken.depth == 0:
            _Unbroken.is_interrupted = False
            raise KeyboardInterrupt


def interrupt(thread: int, hung: str) -> None:
    """Raise `KeyboardInterrupt` in a thread that waits for what does not come back; it calls `interrupt_heard`.

    Args:
        thread: Its number, as `threading.get_ident` gives it.
        hung: What does not come back, in one line, for the case that it never hears.
    """
    number = _raising()
    if number is not None and thread == threading.main_thread().ident:
        _Heard.hung = hung
        signal.pthread_kill(thread, number)
        return
    # It hears when it next runs Python.
    raising = ctypes.pythonapi.PyThreadState_SetAsyncExc
    raising(ctypes.c_ulong(thread), ctypes.py_object(KeyboardInterrupt))


def _raising() -> signal.Signals | None:
    """Return the signal that raises `KeyboardInterrupt` in the main thread; None where none does."""
    if not hasattr(signal, "pthread_kill"):
        return None
    if callable(signal.getsignal(signal.SIGINT)):
        return signal.SIGINT
    return signal.SIGUSR1 if signal.getsignal(signal.SIGUSR1) is signal.default_int_handler else None


def interrupt_heard() -> None:
    """Say that the interrupt of this program itself has come where it was meant for."""
    _Heard.hung = None


def interrupt_in_worker() -> None:
    """Let `interrupt` reach the main thread of a process that ignores Ctrl-C."""
    if hasattr(signal, "SIGUSR1"):
        signal.signal(signal.SIGUSR1, signal.default_int_handler)


def end_hung(hung: str) -> None:
    """End this process, with what `last_words` saves, where it is this program's own; else say it once.

    Args:
        hung: What does not come back, in one line.
    """
    if _ours:
        leave_now(_USER_ERROR, f"{hung}; {_saved()}" if _last_words else hung)
    if _Heard.warned != hung:
        _Heard.warned = hung
        _logger.warning("%s, and cannot be interrupted", hung)


@contextmanager
def held_back() -> Iterator[None]:
    """Keep Ctrl-C until the end of this; processes and threads that are started meanwhile do not hear it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, INTERRUPTS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _leave(_signal: int, _frame: FrameType | None) -> NoReturn:
    os._exit(130)


def _interrupt(number: int, _frame: FrameType | None) -> None:
    _Heard.at = time.monotonic()
    if number not in (signal.SIGINT, signal.SIGTERM):
        _forget_terminal()
    if _Unbroken.depth == 0:
        raise KeyboardInterrupt
    if not _last_words:
        leave_now(130, "interrupted before there was a result")
    _Unbroken.is_interrupted = True


def _unraisable(what: sys.UnraisableHookArgs) -> None:
    """Hear of Ctrl-C where Python would show a traceback and go on: it comes while compilers clean up, say."""
    if issubclass(what.exc_type, KeyboardInterrupt) and hasattr(signal, "pthread_kill"):
        # Now it could not be raised either.
        again = threading.Timer(_LOOK, signal.pthread_kill, [threading.main_thread().ident, signal.SIGINT])
        again.daemon = True
        again.start()
    elif _Heard.at == -math.inf:
        sys.__unraisablehook__(what)
    # What it left half made complains as it goes.


def _forget_terminal() -> None:
    """Let what is printed go nowhere: a terminal that is gone refuses it, and the run would break off."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in _terminals:
        os.dup2(nowhere, descriptor)


def _end_what_hears_nothing(reading: int) -> NoReturn:
    while True:
        # Every signal that Python has a handler for writes its number, at once, whatever the main thread does.
        if INTERRUPTS.isdisjoint(os.read(reading, 100)) or signal.getsignal(signal.SIGINT) is not _interrupt:
            continue
        pressed = time.monotonic()
        # It hears of several at once, and may have done so before this thread has its turn.
        while _Heard.at < pressed - _PATIENCE and time.monotonic() < pressed + _PATIENCE:
            time.sleep(_LOOK)
        if _Heard.at < pressed - _PATIENCE:
            if _Heard.hung is not None:
                leave_now(_USER_ERROR, f"{_Heard.hung}; {_saved()}")
            leave_now(130, f"interrupted in code that did not return; {_saved()}")


def _saved() -> str:
    said = ["nothing was saved"]

    def save() -> None:
        said.append(_last_words[-1]())

    if _last_words:
        # It may call what does not return either.
        saving = threading.Thread(target=save, daemon=True)
        saving.start()
        saving.join(_SAVING)
    return said[-1]
