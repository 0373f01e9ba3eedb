"""One hard tree, one episode after another, and every step written down."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import compiled
from ge_torchrl.environments.kernels.decisions import answer, goes_left
from ge_torchrl.environments.kernels.dynamics import advance
from ge_torchrl.environments.kernels.lanes import (
    ACTION,
    LANE_ROWS,
    LANES,
    OBSERVATION,
    REWARD,
    TERMINATED,
)
from ge_torchrl.trees.forest import ForestArrays


class Recording(NamedTuple):
    """Room for `T` steps, and the observation behind the last one.

    Attributes:
        observations: [T + 1, D] float32, what each action was chosen on; the last is what came of the last action.
        actions: [T] int64; [0] where an action is values.
        values: [T, A] float32, as the environment was given them; [0, 0] where an action is a number.
        rewards: [T] float64.
        terminated: [T] bool, the task ended the episode.
        truncated: [T] bool, the episode reached its limit.
    """

    observations: NDArray[np.float32]
    actions: NDArray[np.int64]
    values: NDArray[np.float32]
    rewards: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]

    @classmethod
    def empty(cls, n_steps: int, n_features: int, n_values: int) -> Recording:
        """Return room for `n_steps` steps, whose actions are `n_values` values or, where that is 0, numbers."""
        return cls(
            np.empty((n_steps + 1, n_features), np.float32),
            np.empty(0 if n_values else n_steps, np.int64),
            np.empty((n_steps if n_values else 0, n_values), np.float32),
            np.empty(n_steps),
            np.empty(n_steps, np.bool_),
            np.empty(n_steps, np.bool_),
        )


@compiled
def _leaf_of(rows: NDArray[np.float64], forest: ForestArrays, tree: int) -> int:
    split_start, leaf_start = forest.split_start[tree], forest.leaf_start[tree]
    node = 0 if forest.split_start[tree + 1] > split_start else -1
    while node >= 0:
        row = split_start + node
        is_left = goes_left(rows, 0, forest, row)
        node = int(forest.children_left[row] if is_left else forest.children_right[row])
    return int(leaf_start + ~node)


@compiled
def _observe(rows: NDArray[np.float64], observation: NDArray[np.float32]) -> None:
    for feature in range(len(observation)):
        observation[feature] = np.float32(rows[OBSERVATION + feature * LANES])


@compiled
def record_steps(
    dynamics: int,
    max_episode_steps: int,
    starts: NDArray[np.float64],
    bounds: NDArray[np.float64],
    forest: ForestArrays,
    tree: int,
    recording: Recording,
    first: int,
) -> int:
    """Write the episodes of `starts`, one after another, from row `first` on until there is no more room.

    Args:
        dynamics: What `advance` takes.
        max_episode_steps: Truncation.
        starts: [E, S], the episodes' first states and observations.
        bounds: As `run_forest` takes them.
        forest: The trees.
        tree: Which of them acts.
        recording: Written.
        first: First row to write.

    Returns:
        One past the last row written.
    """
    rows = np.zeros(LANE_ROWS * LANES)
    no_visits = np.zeros(0, np.int64)
    t, room, n_values = first, len(recording.rewards), recording.values.shape[1]
    for episode in range(len(starts)):
        for row in range(starts.shape[1]):
            rows[row * LANES] = starts[episode, row]
        steps, ended = 0, False
        while not ended and t < room:
            _observe(rows, recording.observations[t])
            answer(rows, 0, forest, _leaf_of(rows, forest, tree), bounds, no_visits)
            if n_values == 0:
                recording.actions[t] = int(rows[ACTION])
            for entry in range(n_values):
                recording.values[t, entry] = np.float32(rows[ACTION + entry * LANES])
            advance(dynamics, rows, 1)
            steps += 1
            terminated, truncated = rows[TERMINATED] != 0.0, steps >= max_episode_steps
            recording.rewards[t] = rows[REWARD]
            recording.terminated[t], recording.truncated[t] = terminated, truncated
            ended = terminated or truncated
            t += 1
            _observe(rows, recording.observations[t])
    return t
