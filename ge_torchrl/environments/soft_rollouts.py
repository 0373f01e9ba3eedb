"""Fused sampling of a soft tree: descent, action, physics, reward and reset in one compiled loop.

A soft tree is a mixture: the leaf is drawn by the path weights, the action by the leaf's probabilities. Going down
at random, left with the weight of the left branch, draws from exactly that mixture at the cost of a single path.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import compiled
from ge_torchrl.environments.dynamics import (
    ACTION,
    DYNAMICS,
    LANE_ROWS,
    LANES,
    OBSERVATION,
    REWARD,
    START_ROWS,
    TERMINATED,
    advance,
)
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.decision_tree import FloatArray, IntArray

# A start costs some ten microseconds, and so does a call of the kernel: few are made ahead, and not one by one.
_STARTS_PER_BLOCK = 32


class SoftTree(NamedTuple):
    """A tree whose decisions and leaves are random; node `j` goes left with probability `sigma(alpha_j (phi - x))`.

    Attributes:
        feature: [N] int32, as in `DecisionTree`.
        threshold: [N] float32, likewise.
        children_left: [N] int32, likewise.
        children_right: [N] int32, likewise.
        probabilities: [N, A] float64, a leaf's probability of each action; rows of decision nodes are not read.
        alpha: [N] float64, steepness of each decision by one unit of its feature; those of leaves are not read.
    """

    feature: IntArray
    threshold: FloatArray
    children_left: IntArray
    children_right: IntArray
    probabilities: NDArray[np.float64]
    alpha: NDArray[np.float64]


class Samples(NamedTuple):
    """`T` consecutive steps of one stream of episodes.

    Attributes:
        observations: [T, D] float32, what the action was chosen on.
        actions: [T] int64.
        rewards: [T] float32.
        next_observations: [T, D] float32, before any reset.
        terminated: [T] bool, the task ended the episode.
        truncated: [T] bool, the episode reached its limit.
        step_counts: [T] int64, steps of the episode up to and with this one.
        episode_returns: [T] float32, its rewards so far; the return of the episode where it ends.
    """

    observations: FloatArray
    actions: NDArray[np.int64]
    rewards: FloatArray
    next_observations: FloatArray
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    step_counts: NDArray[np.int64]
    episode_returns: FloatArray

    @classmethod
    def empty(cls, n_steps: int, n_features: int) -> Samples:
        """Return room for `n_steps` steps."""
        return cls(
            observations=np.empty((n_steps, n_features), np.float32),
            actions=np.empty(n_steps, np.int64),
            rewards=np.empty(n_steps, np.float32),
            next_observations=np.empty((n_steps, n_features), np.float32),
            terminated=np.empty(n_steps, np.bool_),
            truncated=np.empty(n_steps, np.bool_),
            step_counts=np.empty(n_steps, np.int64),
            episode_returns=np.empty(n_steps, np.float32),
        )


class SoftSampler:
    """Samples one endless stream of episodes; an episode that a call cuts goes on in the next one.

    Episodes start as `reset(seed=s)` starts them, with training seeds drawn from `rng`, which draws the decisions
    and actions as well. The stream depends on `rng` and the trees alone, not on how calls cut it.

    Args:
        spec: An environment of `DYNAMICS`.
        rng: The source of randomness.

    Raises:
        EnvironmentFaultError: The environment has no compiled dynamics.
    """

    def __init__(self, spec: EnvironmentSpec, rng: np.random.Generator) -> None:
        if spec.id not in DYNAMICS:
            raise EnvironmentFaultError(
                f"fused samples need compiled dynamics, which exist for {', '.join(DYNAMICS)}; got {spec.id}"
            )
        self.spec = spec
        self._dynamics = DYNAMICS[spec.id]
        self._rng = rng
        self._starts = np.empty((0, START_ROWS))
        self._stream = _Stream(np.zeros(LANE_ROWS * LANES), np.zeros(1, np.int64), np.zeros(1))

    def sample(self, tree: SoftTree, n_steps: int) -> Samples:
        """Take `n_steps` steps.

        Args:
            tree: The soft tree that acts.
            n_steps: Number of steps, T.

        Returns:
            The steps, in their order.
        """
        samples = Samples.empty(n_steps, self.spec.n_features)
        n_done = 0
        while True:
            n_done, n_used = _fill(
                self._dynamics.index,
                self.spec.max_episode_steps,
                tree,
                self._stream,
                self._starts,
                samples,
                n_done,
                self._rng,
            )
            self._starts = self._starts[n_used:]
            if n_done == n_steps:
                return samples
            self._starts = self._dynamics.starts(episode_seeds("training", _STARTS_PER_BLOCK, self._rng))


class _Stream(NamedTuple):
    """The episode under way, in lane 0 of a buffer that `dynamics` lays out.

    Attributes:
        rows: [LANE_ROWS * LANES] float64.
        steps: [1] int64, steps so far; 0 where an episode must begin.
        total: [1] float64, the return so far.
    """

    rows: NDArray[np.float64]
    steps: NDArray[np.int64]
    total: NDArray[np.float64]


@compiled
def _draw_action(tree: SoftTree, rows: NDArray[np.float64], rng: np.random.Generator) -> int:
    """Draw a path from the root, then an action from the leaf."""
    node = 0
    while tree.children_left[node] >= 0:
        distance = tree.threshold[node] - rows[OBSERVATION + tree.feature[node] * LANES]
        weight = 1.0 / (1.0 + np.exp(-tree.alpha[node] * distance))
        node = tree.children_left[node] if rng.random() < weight else tree.children_right[node]
    action, left_over = 0, rng.random() - tree.probabilities[node, 0]
    # What rounding leaves of a sum of one falls to the last action.
    while left_over >= 0.0 and action < tree.probabilities.shape[1] - 1:
        action += 1
        left_over -= tree.probabilities[node, action]
    return action


@compiled
def _begin_episode(stream: _Stream, starts: NDArray[np.float64], index: int) -> None:
    stream.total[0] = 0.0
    for row in range(START_ROWS):
        stream.rows[row * LANES] = starts[index, row]


@compiled
def _observe(rows: NDArray[np.float64], observations: FloatArray, t: int) -> None:
    for feature in range(observations.shape[1]):
        observations[t, feature] = rows[OBSERVATION + feature * LANES]


@compiled
def _fill(
    dynamics: int,
    max_episode_steps: int,
    tree: SoftTree,
    stream: _Stream,
    starts: NDArray[np.float64],
    samples: Samples,
    first: int,
    rng: np.random.Generator,
) -> tuple[int, int]:
    """Write samples from row `first` on, until they are full or an episode must begin and no start is left.

    Returns:
        The row behind the last one written, and the number of starts used.
    """
    rows = stream.rows
    n_used = 0
    for t in range(first, len(samples.actions)):
        if stream.steps[0] == 0:
            if n_used == len(starts):
                return t, n_used
            _begin_episode(stream, starts, n_used)
            n_used += 1
        _observe(rows, samples.observations, t)
        action = _draw_action(tree, rows, rng)
        rows[ACTION] = action
        advance(dynamics, rows, 1)
        _observe(rows, samples.next_observations, t)
        stream.steps[0] += 1
        stream.total[0] += rows[REWARD]
        terminated, truncated = rows[TERMINATED] != 0.0, stream.steps[0] >= max_episode_steps
        samples.actions[t], samples.rewards[t] = action, rows[REWARD]
        samples.terminated[t], samples.truncated[t] = terminated, truncated
        samples.step_counts[t], samples.episode_returns[t] = stream.steps[0], stream.total[0]
        if terminated or truncated:
            stream.steps[0] = 0
    return len(samples.actions), n_used
