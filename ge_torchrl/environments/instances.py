"""How many copies of an environment may live at once: a simulator can take a hundred megabytes each."""

from __future__ import annotations

import os
from contextlib import closing
from pathlib import Path

import numpy as np

from ge_torchrl.environments.border import Border, random_action
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.environments.witness import Witness

ROOM = 2 * 1024**3
"""What the copies of a vector environment may take together, in all processes [bytes]."""
COPIES = 8
"""Copies that PPO steps for each tree; a constant, so that a tree's samples do not depend on who is beside it."""
# Trees that PPO trains as one batch: of fewer, Python takes longer than the numbers; more would not fit into caches.
_TREES_TOGETHER = 32
# What a process takes changes by so much of itself; smaller copies are not worth a bound [bytes].
_SMALLEST = 8 * 1024**2
_STATM = Path("/proc/self/statm")
# Simulators take memory in their first steps too.
_STEPS = 10

_measured: dict[tuple[str, str], int | None] = {}


def trees_together(spec: EnvironmentSpec, *, copied: bool) -> int:
    """Return how many trees PPO trains as one batch.

    Args:
        spec: The environment.
        copied: Whether it is stepped in copies; kernels sample without.

    Raises:
        EnvironmentFaultError: The environment is at fault.
    """
    copies = copies_that_fit(spec) if copied else None
    return _TREES_TOGETHER if copies is None else min(_TREES_TOGETHER, max(copies // COPIES, 1))


def copies_that_fit(spec: EnvironmentSpec) -> int | None:
    """Return how many copies of an environment fit into `ROOM`, a power of two and at least 1; None: any number.

    One copy is measured, once in a process; rounding keeps what little two measurements differ by out of the answer.
    Where the system does not tell how much memory a process takes, it is any number.

    Raises:
        EnvironmentFaultError: The environment is at fault.
    """
    key = (spec.id, repr(spec.names))
    if key not in _measured:
        _measured[key] = _fitting(_size(spec))
    return _measured[key]


def _fitting(size: int) -> int | None:
    if size < _SMALLEST:
        return None
    return 1 << (max(ROOM // size, 1).bit_length() - 1)


def _size(spec: EnvironmentSpec) -> int:
    """Return what a further copy takes [bytes]; modules and what copies share come with the first."""
    with closing(Border(spec, Witness(spec))) as first:
        _begin(spec, first)
        before = _taken()
        with closing(Border(spec, Witness(spec))) as second:
            _begin(spec, second)
            return _taken() - before


def _begin(spec: EnvironmentSpec, border: Border) -> None:
    rng = np.random.default_rng(0)
    border.reset(0)
    for _ in range(_STEPS):
        _, _, terminated, truncated = border.step(random_action(spec, rng))
        if terminated or truncated:
            break


def _taken() -> int:
    if not _STATM.exists():
        return 0
    return int(_STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
