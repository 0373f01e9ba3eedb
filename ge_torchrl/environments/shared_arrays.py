"""What the processes of a vector environment read and write, side by side in memory that they share."""

from __future__ import annotations

import ctypes
import multiprocessing
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class Arrays(NamedTuple):
    """What is read and written side by side, in memory that processes share.

    All are [n], but observations [n, D] and, where an action is numbers, actions [n, A].
    """

    observations: NDArray[np.float32]
    actions: NDArray[np.int64] | NDArray[np.float32]
    rewards: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    seeds: NDArray[np.int64]
    is_reset: NDArray[np.bool_]

    def part(self, first: int, end: int) -> Arrays:
        """Return the copies `first` to `end` alone."""
        return Arrays._make(array[first:end] for array in self)


class Memory(NamedTuple):
    """The memory under `Arrays`, as it travels to another process."""

    n: int
    n_features: int
    n_values: int
    buffers: tuple[Any, ...]

    @classmethod
    def empty(cls, n: int, n_features: int, n_values: int = 0) -> Memory:
        """Return new memory for `n` copies, whose actions are numbers, or `n_values` floats each."""
        sizes = {"observations": n * n_features, "actions": n * (n_values or 1)}
        types = (
            ctypes.c_float,
            ctypes.c_float if n_values else ctypes.c_int64,
            ctypes.c_double,
            ctypes.c_bool,
            ctypes.c_bool,
            ctypes.c_int64,
            ctypes.c_bool,
        )
        context = multiprocessing.get_context("spawn")
        fields = zip(Arrays._fields, types, strict=True)
        return cls(
            n,
            n_features,
            n_values,
            tuple(context.RawArray(kind, sizes.get(name, n)) for name, kind in fields),
        )

    def arrays(self) -> Arrays:
        """Return the arrays that lie in this memory."""
        flat = [np.frombuffer(buffer, np.dtype(buffer._type_)) for buffer in self.buffers]
        arrays = Arrays(*flat)
        return arrays._replace(
            observations=arrays.observations.reshape(self.n, self.n_features),
            actions=arrays.actions.reshape(self.n, self.n_values) if self.n_values else arrays.actions,
        )
