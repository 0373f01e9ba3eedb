"""Fused sampling of soft trees: descent, action, physics, reward and reset in one compiled loop.

A few streams run side by side, one a lane, so that physics takes one vector step for all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import compiled, inlined
from ge_torchrl.environments.backend import Samples, SoftForest
from ge_torchrl.environments.kernels.decisions import clipped
from ge_torchrl.environments.kernels.draws import seed_generator
from ge_torchrl.environments.kernels.dynamics import advance
from ge_torchrl.environments.kernels.lanes import (
    ACTION,
    LANE_ROWS,
    LANES,
    OBSERVATION,
    REWARD,
    TERMINATED,
    VECTOR,
    Starts,
)
from ge_torchrl.environments.kernels.soft_draws import draw_action, draw_leaf, draw_value
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.seeding import episode_seeds

# Episodes are begun ahead, so that a kernel seldom comes back for more.
_STARTS_PER_BLOCK = 32
_BLOCKS = 2


class _Streams(NamedTuple):
    """A few streams of episodes, one a lane.

    Attributes:
        rows: [LANE_ROWS * LANES] float64, as `dynamics` lays them out.
        steps: [n] int64, steps so far; 0 where an episode must begin.
        total: [n] float64, the return so far.
        starts: [n, _BLOCKS * _STARTS_PER_BLOCK, S], episodes to come.
        used: [n] int64, how many of these are used.
        generator: [n, 4] uint64, draws decisions and actions.
    """

    rows: NDArray[np.float64]
    steps: NDArray[np.int64]
    total: NDArray[np.float64]
    starts: NDArray[np.float64]
    used: NDArray[np.int64]
    generator: NDArray[np.uint64]


class _Room(NamedTuple):
    """`Samples`, whose actions are numbers `actions` [R, T] or `values` [R, T, A]; the other is empty."""

    observations: NDArray[np.float32]
    actions: NDArray[np.int64]
    values: NDArray[np.float32]
    rewards: NDArray[np.float32]
    next_observations: NDArray[np.float32]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    episode_returns: NDArray[np.float32]


@inlined
def _begin_episodes(streams: _Streams, n: int) -> bool:
    """Begin the episodes that must begin; tell whether all could."""
    for lane in range(n):
        if streams.steps[lane] == 0 and streams.used[lane] == streams.starts.shape[1]:
            return False
    for lane in range(n):
        if streams.steps[lane] == 0:
            for row in range(streams.starts.shape[2]):
                streams.rows[row * LANES + lane] = streams.starts[lane, streams.used[lane], row]
            streams.used[lane] += 1
            streams.total[lane] = 0.0
    return True


@compiled
def _fill(
    dynamics: int,
    max_episode_steps: int,
    soft: SoftForest,
    first_tree: int,
    streams: _Streams,
    bounds: NDArray[np.float64],
    samples: _Room,
    first: int,
    last: int,
) -> int:
    """Write steps `first` to `last - 1` of trees `first_tree` to `first_tree + n - 1`.

    Returns:
        `last`, or the step where an episode must begin and no start is left.
    """
    rows, n, n_values = streams.rows, len(streams.steps), samples.values.shape[2]
    for t in range(first, last):
        if not _begin_episodes(streams, n):
            return t
        for lane in range(n):
            r = first_tree + lane
            for feature in range(samples.observations.shape[2]):
                samples.observations[r, t, feature] = rows[OBSERVATION + feature * LANES + lane]
            leaf = draw_leaf(soft, r, rows, lane, streams.generator[lane])
            if n_values == 0:
                action = draw_action(soft, r, leaf, streams.generator[lane])
                samples.actions[r, t] = action
                rows[ACTION + lane] = action
            for entry in range(n_values):
                value = draw_value(soft, r, leaf, entry, rows, lane, streams.generator[lane])
                samples.values[r, t, entry] = np.float32(value)
                rows[ACTION + entry * LANES + lane] = clipped(value, bounds, entry)
        advance(dynamics, rows, n)
        for lane in range(n):
            r = first_tree + lane
            for feature in range(samples.observations.shape[2]):
                samples.next_observations[r, t, feature] = rows[OBSERVATION + feature * LANES + lane]
            reward = rows[REWARD + lane]
            streams.steps[lane] += 1
            streams.total[lane] += reward
            terminated = rows[TERMINATED + lane] != 0.0
            truncated = streams.steps[lane] >= max_episode_steps
            samples.rewards[r, t], samples.episode_returns[r, t] = reward, streams.total[lane]
            samples.terminated[r, t], samples.truncated[r, t] = terminated, truncated
            if terminated or truncated:
                streams.steps[lane] = 0
    return last


def _room(samples: Samples) -> _Room:
    """Return views of samples; one type for both kinds of action is one compilation."""
    fields = samples._asdict()
    if samples.actions.ndim == 2:
        return _Room(**fields, values=np.zeros((0, 0, 0), np.float32))
    return _Room(**{**fields, "actions": np.zeros((0, 0), np.int64)}, values=samples.actions)


def check_soft_forest(soft: SoftForest, n_trees: int, spec: EnvironmentSpec) -> None:
    """Refuse what a kernel would read beyond its arrays or never come back from.

    Raises:
        ValueError: There are more or fewer trees than streams, a child is no later split and no leaf, or leaves do not
            draw the environment's actions.
    """
    n_splits, n_leaves = soft.feature.shape[1], soft.n_leaves
    children = np.stack([soft.children_left, soft.children_right])
    if len(soft.feature) != n_trees:
        raise ValueError(f"{n_trees} streams need as many soft trees; got {len(soft.feature)}")
    is_split = (children > np.arange(n_splits)) & (children < n_splits)
    is_leaf = (children < 0) & (~children < n_leaves)
    if not (is_split | is_leaf).all():
        raise ValueError("a child must be a split behind its parent, or ~leaf; rows of padding hold ~0 twice")
    leaves = soft.mean if spec.is_continuous else soft.probabilities
    if leaves.shape != (n_trees, n_leaves, spec.n_actions):
        kind = "a mean for each entry of an action" if spec.is_continuous else "a probability for each action"
        raise ValueError(
            f"each leaf needs {kind} of {spec.id}, [{n_trees}, {n_leaves}, {spec.n_actions}]; got "
            f"{list(leaves.shape)}"
        )


class SoftStreams:
    """Samples a few streams of episodes, each endless; an episode that a call cuts goes on in the next one.

    Episodes start as `reset(seed=s)` starts them, with training seeds that the stream's own `rng` draws; it seeds the
    draws of decisions and actions too. A stream depends on its `rng` and its trees alone: not on how calls cut it,
    and not on the streams beside it.

    Args:
        dynamics: What `advance` takes.
        make_starts: Episode seeds [E] to start rows [E, S].
        max_episode_steps: Truncation.
        bounds: [2, A], lowest and highest value of each entry of an action; [2, 0] where an action is a number.
        rngs: [n] sources of randomness, of at most `LANES` streams.
    """

    # So many streams fill the vector registers; more would keep other threads from work.
    WIDTH = VECTOR

    def __init__(
        self,
        dynamics: int,
        make_starts: Callable[[NDArray[np.int64]], Starts],
        max_episode_steps: int,
        bounds: NDArray[np.float64],
        rngs: Sequence[np.random.Generator],
    ) -> None:
        self._dynamics = dynamics
        self._make_starts = make_starts
        self._max_episode_steps = max_episode_steps
        self._bounds = bounds
        self._rngs = rngs
        n, n_starts = len(rngs), _BLOCKS * _STARTS_PER_BLOCK
        self._streams = _Streams(
            rows=np.zeros(LANE_ROWS * LANES),
            steps=np.zeros(n, np.int64),
            total=np.zeros(n),
            starts=np.zeros((n, n_starts, make_starts(np.zeros(0, np.int64)).shape[1])),
            used=np.full(n, n_starts, np.int64),
            generator=np.zeros((n, 4), np.uint64),
        )
        for lane, rng in enumerate(rngs):
            seed_generator(int(rng.integers(2**62)), self._streams.generator[lane])

    def fill(self, soft: SoftForest, first_tree: int, samples: Samples, first: int, last: int) -> int:
        """Write the next steps of the streams; return 0, since the caller counts them.

        Args:
            soft: The soft trees [R] that act, those from `first_tree` on by these streams.
            first_tree: The tree of the first stream.
            samples: [R, T], written in the rows of these trees.
            first: First step to write.
            last: One past the last step to write.
        """
        t, room = first, _room(samples)
        while t < last:
            self._draw_starts()
            t = _fill(
                self._dynamics,
                self._max_episode_steps,
                soft,
                first_tree,
                self._streams,
                self._bounds,
                room,
                t,
                last,
            )
        return 0

    def _draw_starts(self) -> None:
        """Fill up the episodes to come, in whole blocks: a stream's seeds do not depend on when that is."""
        starts, used = self._streams.starts, self._streams.used
        for lane, rng in enumerate(self._rngs):
            while used[lane] >= _STARTS_PER_BLOCK:
                block = self._make_starts(episode_seeds("training", _STARTS_PER_BLOCK, rng))
                starts[lane] = np.concatenate([starts[lane, _STARTS_PER_BLOCK:], block])
                used[lane] -= _STARTS_PER_BLOCK
