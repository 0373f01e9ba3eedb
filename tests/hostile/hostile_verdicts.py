"""How a piece of the program takes a bad input: told in one line, as documented, or in a way that it never should."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from ge_torchrl.errors import RunFaultError, UserError

TOLD, PASSED = "told in one line", "no complaint"
TRACEBACK, LONG, RAW, HANG = "traceback", "message too long", "message with control characters", "hang"
LONGEST_MESSAGE = 1000
_SECONDS = 20.0


class Case(NamedTuple):
    """A bad input.

    Attributes:
        name: What is bad.
        act: Meets it.
        expected: `TOLD`, or `PASSED` where the documents say that it is taken.
    """

    name: str
    act: Callable[[], object]
    expected: str = TOLD


class Verdict(NamedTuple):
    """What became of a bad input.

    Attributes:
        kind: One of the constants above.
        told: The message.
    """

    kind: str
    told: str


class _TooLongError(BaseException):
    """No code of the program catches it."""


def judged(act: Callable[[], object]) -> Verdict:
    """Return what becomes of a bad input."""
    try:
        with _limited():
            act()
    except _TooLongError:
        return Verdict(HANG, f"after {_SECONDS:g} s")
    except (UserError, RunFaultError) as error:
        return Verdict(_kind_of(str(error)), str(error))
    except (Exception, SystemExit) as error:  # noqa: BLE001 - it is what is looked for.
        return Verdict(TRACEBACK, f"{type(error).__name__}: {error}"[:300])
    return Verdict(PASSED, "")


def _kind_of(message: str) -> str:
    if len(message) > LONGEST_MESSAGE:
        return LONG
    return TOLD if message.isprintable() else RAW


@contextmanager
def _limited() -> Iterator[None]:
    def stop(*_: Any) -> None:
        raise _TooLongError

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, _SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
