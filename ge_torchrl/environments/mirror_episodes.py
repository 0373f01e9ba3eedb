"""Episodes that are compared with those of a mirror image, cut where time is short."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.border import Border, random_action
from ge_torchrl.environments.probing import Policy
from ge_torchrl.environments.spec import EnvironmentSpec

SIGHTS: Final = 8
"""Episodes of `sights`."""
LONGEST_EPISODE: Final = 200
"""Longer episodes are cut: those of an image are as long, and what is cut is cut alike."""
_STEPS_OF_A_SIGHT: Final = 30


class Played(NamedTuple):
    """Episodes: what each returned, [E, 1] float64, and what was seen on the average and at its end, [E, D] float32."""

    total: NDArray[np.float64]
    mean: NDArray[np.float32]
    last: NDArray[np.float32]


def sights(
    border: Border, spec: EnvironmentSpec, rng: np.random.Generator, seeds: Iterator[int], deadline: float
) -> Iterator[NDArray[np.float32]]:
    """Yield what is seen [D] where an action is held on to, in a few episodes.

    Args:
        border: The environment.
        spec: Its description.
        rng: Chooses the actions.
        seeds: Of episodes.
        deadline: When each episode is cut to its first step, on the clock of `time.perf_counter` [s].
    """
    for seed in itertools.islice(seeds, SIGHTS):
        border.reset(seed)
        action, n_steps, ended = random_action(spec, rng), 0, False
        yield border.array.copy()
        while not ended and n_steps < _STEPS_OF_A_SIGHT:
            _, _, terminated, truncated = border.step(action)
            yield border.array.copy()
            n_steps, ended = n_steps + 1, terminated or truncated or time.perf_counter() > deadline


def episodes(
    border: Border, policy: Policy, seeds: Iterator[int], n_episodes: int, deadline: float
) -> Played:
    """Return what came of a policy's episodes, of those that ended before the deadline.

    Args:
        border: The environment.
        policy: Acts in it.
        seeds: Of episodes.
        n_episodes: How many are played, E at most.
        deadline: On the clock of `time.perf_counter` [s].
    """
    totals, means, lasts = list[list[float]](), list[NDArray[np.float64]](), list[NDArray[np.float32]]()
    for seed in itertools.islice(seeds, n_episodes):
        border.reset(seed)
        total, sums, n_steps, ended = 0.0, border.array.astype(np.float64), 1, False
        while not ended and n_steps <= LONGEST_EPISODE and time.perf_counter() < deadline:
            _, reward, terminated, truncated = border.step(policy(border.array))
            total, sums, n_steps = total + reward, sums + border.array, n_steps + 1
            ended = terminated or truncated
        if time.perf_counter() >= deadline:
            break
        totals.append([total])
        means.append(sums / n_steps)
        lasts.append(border.array.copy())
    return Played(np.array(totals), np.array(means, np.float32), np.array(lasts))
