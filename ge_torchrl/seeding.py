"""One seed of a run becomes named streams of random numbers that do not depend on each other.

A stream is found by its name, not by the order of its creation, so a new consumer of randomness changes no
other one.
"""

import hashlib
from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Purpose = Literal["training", "validation", "test"]

EPISODE_SEEDS: Mapping[Purpose, range] = MappingProxyType(
    {
        "training": range(1 << 29, 2 << 29),
        "validation": range(2 << 29, 3 << 29),
        "test": range(3 << 29, 4 << 29),
    }
)
"""The reset seeds of each purpose; those below 2**29 are left to seeds that people type by hand."""


def stream(seed: int, name: str) -> np.random.Generator:
    """Return the stream `name` of the run `seed`: `PCG64(SeedSequence(seed, spawn_key=sha256(name)))`.

    The same seed and name give the same stream on every machine; different ones give independent streams
    (O'Neill's seed sequence, as in NumPy's "Parallel random number generation").

    Args:
        seed: The seed of the run, at least 0.
        name: What the numbers are for, such as `"mutation"`.

    Returns:
        A new generator at the start of the stream.

    Raises:
        ValueError: The seed is negative.
    """
    # Python's own hash of a text changes from process to process, and the byte order is fixed for other
    # machines.
    key = np.frombuffer(hashlib.sha256(name.encode()).digest()[:16], dtype="<u4")
    sequence = np.random.SeedSequence(seed, spawn_key=tuple(int(word) for word in key))
    return np.random.Generator(np.random.PCG64(sequence))


def episode_seeds(purpose: Purpose, n: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Draw seeds for `env.reset(seed=...)` without repetition.

    The purposes draw from disjoint ranges (`EPISODE_SEEDS`), so no tree is tested on an episode that it, or
    any other tree, was trained on or chosen by.

    Args:
        purpose: What the episodes are for.
        n: Number of episodes, at least 0.
        rng: The source of randomness.

    Returns:
        [E] int64 with `E = n`, in [0, 2**31).

    Raises:
        ValueError: `n` is negative.
    """
    seeds = EPISODE_SEEDS[purpose]
    return seeds.start + rng.choice(len(seeds), size=n, replace=False).astype(np.int64)
