"""Ctrl-C while packages are imported: there is nothing to save yet, so the program leaves without a traceback."""

import os
import signal
from types import FrameType
from typing import NoReturn


def leave_quietly() -> None:
    """Let Ctrl-C end this process at once with status 130, until `interrupt_again`."""
    signal.signal(signal.SIGINT, _leave)


def interrupt_again() -> None:
    """Let Ctrl-C raise `KeyboardInterrupt` again where `leave_quietly` was called; elsewhere nothing changes."""
    if signal.getsignal(signal.SIGINT) is _leave:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _leave(_signal: int, _frame: FrameType | None) -> NoReturn:
    os._exit(130)
