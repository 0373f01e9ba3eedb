"""Items of different lengths end to end: item `i` owns the rows `start[i]` to `start[i + 1]`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def starts(lengths: ArrayLike) -> NDArray[np.int64]:
    """Return where items of these lengths begin, [n + 1] int64; the last entry is the number of all rows."""
    counts = np.asarray(lengths, dtype=np.int64)
    start = np.zeros(len(counts) + 1, np.int64)
    np.cumsum(counts, out=start[1:])
    return start


def gather(
    start: NDArray[np.int64] | NDArray[np.int32], items: ArrayLike
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rows of some items, in the order of the items.

    Args:
        start: [n + 1] where each item begins.
        items: [k] the items, each as often as it is wanted.

    Returns:
        Where each of the `k` items begins among the gathered rows, [k + 1], and the gathered rows themselves.
    """
    chosen = np.asarray(items, dtype=np.int64)
    begin = start[:-1][chosen].astype(np.int64)
    lengths = start[1:][chosen] - begin
    gathered = starts(lengths)
    rows = np.arange(gathered[-1]) + np.repeat(begin - gathered[:-1], lengths)
    return gathered, rows
