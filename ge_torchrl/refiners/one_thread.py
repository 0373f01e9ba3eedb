"""NumPy's linear algebra on one thread, for matrices that are too small to share.

From some forty numbers on, NumPy's library shares what CMA-ES multiplies between threads, which wait for each other by
spinning: sixty rounds of a hundred numbers took 4.3 seconds of a busy processor, and 1.4 with one thread. How a sum is
shared can decide its last bits, too, and a launcher of several jobs gives each of them fewer threads.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep NumPy's linear algebra on one thread; afterwards it has as many as before.

    It is entered by the thread that waits for all others: OpenBLAS does not obey any other one.
    """
    with _libraries().limit(limits=1, user_api="blas"):
        yield


@cache
def _libraries() -> Any:
    # It comes with CMA-ES, whose import takes far longer.
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
