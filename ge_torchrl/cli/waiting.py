"""A word to whoever waits."""

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_SILENCE_SECONDS = 1.5


@contextmanager
def looked_at(environment_id: str) -> Iterator[None]:
    """Say on standard error what is being looked at, once that takes longer than a person waits without a word."""
    told = threading.Timer(
        _SILENCE_SECONDS,
        lambda: print(f"ge-torchrl: looking at {environment_id} ...", file=sys.stderr, flush=True),
    )
    told.daemon = True
    told.start()
    try:
        yield
    finally:
        told.cancel()
