"""A word to whoever waits."""

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from ge_torchrl.cli.statuses import USER_ERROR
from ge_torchrl.interrupts import Stepping, leave_now

_SILENCE_SECONDS = 1.5
# A compiled step that takes longer does not return [s].
_STEP_SECONDS = 20.0


@contextmanager
def looked_at(environment_id: str) -> Iterator[None]:
    """Say on standard error what is being looked at, once that takes longer than a person waits without a word.

    Where a step of a user's own dynamics does not return meanwhile, that is said and the program ends: nothing can
    interrupt compiled code.
    """
    seen = threading.Event()

    def watch() -> None:
        if seen.wait(_SILENCE_SECONDS):
            return
        print(f"ge-torchrl: looking at {environment_id} ...", file=sys.stderr, flush=True)
        while not seen.wait(_SILENCE_SECONDS):
            if time.perf_counter() - Stepping.since > _STEP_SECONDS:
                leave_now(
                    USER_ERROR,
                    f"env.dynamics={environment_id} must return from every step; one has not in "
                    f"{_STEP_SECONDS:.0f} s: look for a loop in it that may not end",
                )

    threading.Thread(target=watch, daemon=True).start()
    try:
        yield
    finally:
        seen.set()
