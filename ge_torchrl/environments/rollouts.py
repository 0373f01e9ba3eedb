"""Fused rollouts: reset, tree, physics, reward and termination of many episodes in one compiled loop.

Two ways to decide, the same answer (law 4). Where many episodes of one tree run side by side, its splits are
evaluated bottom-up as vector selects: every node for every lane, no branch. Where lanes hold different trees, or a
tree is large, every lane walks its tree.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import compiled
from ge_torchrl.environments.dynamics import (
    ACTION,
    LANE_ROWS,
    LANES,
    OBSERVATION,
    REWARD,
    START_ROWS,
    TERMINATED,
    advance,
)
from ge_torchrl.trees.forest import ForestArrays

# Below these a bottom-up evaluation of all nodes is cheaper than walks (measured by the benchmarks).
SELECT_MAX_NODES = 63
SELECT_MIN_EPISODES = 24


class _Lanes(NamedTuple):
    """The running episodes, one a lane.

    Attributes:
        rows: [LANE_ROWS * LANES] float64, as `dynamics` lays them out.
        total: [LANES] float64, the return so far.
        steps: [LANES] int64, steps so far.
        tree: [LANES] int64, whose episode it is.
        episode: [LANES] int64, which episode it is.
        root: [LANES] int64, the first row of the tree.
    """

    rows: NDArray[np.float64]
    total: NDArray[np.float64]
    steps: NDArray[np.int64]
    tree: NDArray[np.int64]
    episode: NDArray[np.int64]
    root: NDArray[np.int64]


class _Work(NamedTuple):
    """What is to be run, and where its results go.

    Attributes:
        starts: [E, START_ROWS], the episodes' first states and observations.
        max_episode_steps: Truncation.
        returns: [P, E] float64, written.
        lengths: [P, E] int64, written.
        visits: [M] int64, increased by the visits of each node, or [0] to count none.
    """

    starts: NDArray[np.float64]
    max_episode_steps: int
    returns: NDArray[np.float64]
    lengths: NDArray[np.int64]
    visits: NDArray[np.int64]


@compiled
def _decide_by_selects(
    rows: NDArray[np.float64], values: NDArray[np.float64], forest: ForestArrays, tree: int
) -> None:
    """Set every lane's ACTION, empty lanes' too, by evaluating one tree bottom-up.

    Children must follow their parents in the arrays. `values` [N * LANES] holds each node's answer in each lane; the
    leaves' are there already.
    """
    # Unsigned indices: LLVM then sees that none counts from the end, and vectorises.
    lanes = np.uint64(LANES)
    first = forest.offsets[tree]
    for node in range(forest.offsets[tree + 1] - first - 1, -1, -1):
        row = first + node
        if forest.children_left[row] < 0:
            continue
        observed = np.uint64(OBSERVATION) + np.uint64(forest.feature[row]) * lanes
        limit = np.float64(forest.threshold[row])
        left = np.uint64(forest.children_left[row]) * lanes
        right = np.uint64(forest.children_right[row]) * lanes
        answer = np.uint64(node) * lanes
        for i in range(lanes):
            # Both are read whatever the answer: a select has no branch.
            if_true, if_false = values[left + i], values[right + i]
            values[answer + i] = if_true if rows[observed + i] < limit else if_false
    for i in range(lanes):
        rows[np.uint64(ACTION) + i] = values[i]


@compiled
def _decide_by_walks(lanes: _Lanes, forest: ForestArrays, visits: NDArray[np.int64], n: int) -> None:
    """Set every lane's ACTION by walking the lane's own tree; count visits where `visits` is not empty."""
    counting = len(visits) > 0
    for i in range(n):
        root = lanes.root[i]
        node = root
        while forest.children_left[node] >= 0:
            if counting:
                visits[node] += 1
            is_left = lanes.rows[OBSERVATION + forest.feature[node] * LANES + i] < forest.threshold[node]
            node = root + (forest.children_left[node] if is_left else forest.children_right[node])
        if counting:
            visits[node] += 1
        lanes.rows[ACTION + i] = forest.action[node]


@compiled
def _next_tree(forest: ForestArrays, tree: int, last_tree: int) -> int:
    """Return the first individual from `tree` on that has a tree, `last_tree` if none has."""
    while tree < last_tree and forest.offsets[tree + 1] == forest.offsets[tree]:
        tree += 1
    return tree


@compiled
def _start_episode(
    lanes: _Lanes, i: int, work: _Work, forest: ForestArrays, tree: int, episode: int, last_tree: int
) -> tuple[int, int]:
    """Begin an episode of a tree in lane `i`; return the tree and the episode that come next."""
    lanes.tree[i] = tree
    lanes.episode[i] = episode
    lanes.root[i] = forest.offsets[tree]
    lanes.total[i] = 0.0
    lanes.steps[i] = 0
    for row in range(START_ROWS):
        lanes.rows[row * LANES + i] = work.starts[episode, row]
    if episode + 1 < len(work.starts):
        return tree, episode + 1
    return _next_tree(forest, tree + 1, last_tree), 0


@compiled
def _count_step(lanes: _Lanes, max_episode_steps: int, n: int) -> int:
    """Add the step's reward and length to each lane; return how many lanes ended."""
    n_ended = 0
    for i in range(n):
        lanes.total[i] += lanes.rows[REWARD + i]
        lanes.steps[i] += 1
        n_ended += (lanes.rows[TERMINATED + i] != 0.0) | (lanes.steps[i] >= max_episode_steps)
    return n_ended


@compiled
def _move_lane(lanes: _Lanes, source: int, target: int) -> None:
    for row in range(LANE_ROWS):
        lanes.rows[row * LANES + target] = lanes.rows[row * LANES + source]
    lanes.total[target] = lanes.total[source]
    lanes.steps[target] = lanes.steps[source]
    lanes.tree[target] = lanes.tree[source]
    lanes.episode[target] = lanes.episode[source]
    lanes.root[target] = lanes.root[source]


@compiled
def _leaf_values(forest: ForestArrays, tree: int) -> NDArray[np.float64]:
    """Return [N * LANES], the actions of a tree's leaves in every lane."""
    first, last = forest.offsets[tree], forest.offsets[tree + 1]
    values = np.zeros((last - first) * LANES)
    for node in range(last - first):
        values[node * LANES : (node + 1) * LANES] = forest.action[first + node]
    return values


@compiled
def _run_trees(
    dynamics: int, work: _Work, forest: ForestArrays, first_tree: int, last_tree: int, by_selects: bool
) -> None:
    """Run every episode of trees `first_tree` to `last_tree - 1`; with `by_selects` that is one tree.

    A lane that ends takes the next episode; when none is left the last running lane moves into its place.
    """
    lanes = _Lanes(
        np.zeros(LANE_ROWS * LANES),
        np.zeros(LANES),
        np.zeros(LANES, np.int64),
        np.zeros(LANES, np.int64),
        np.zeros(LANES, np.int64),
        np.zeros(LANES, np.int64),
    )
    values = _leaf_values(forest, first_tree) if by_selects else np.zeros(0)
    tree, episode, n = _next_tree(forest, first_tree, last_tree), 0, 0
    while n < LANES and tree < last_tree:
        tree, episode = _start_episode(lanes, n, work, forest, tree, episode, last_tree)
        n += 1
    while n > 0:
        if by_selects:
            _decide_by_selects(lanes.rows, values, forest, first_tree)
        else:
            _decide_by_walks(lanes, forest, work.visits, n)
        advance(dynamics, lanes.rows, n)
        if _count_step(lanes, work.max_episode_steps, n) == 0:
            continue
        for i in range(n - 1, -1, -1):
            if lanes.rows[TERMINATED + i] != 0.0 or lanes.steps[i] >= work.max_episode_steps:
                work.returns[lanes.tree[i], lanes.episode[i]] = lanes.total[i]
                work.lengths[lanes.tree[i], lanes.episode[i]] = lanes.steps[i]
                if tree < last_tree:
                    tree, episode = _start_episode(lanes, i, work, forest, tree, episode, last_tree)
                else:
                    n -= 1
                    _move_lane(lanes, n, i)


@compiled
def run_forest(
    dynamics: int,
    starts: NDArray[np.float64],
    max_episode_steps: int,
    forest: ForestArrays,
    first_tree: int,
    last_tree: int,
    returns: NDArray[np.float64],
    lengths: NDArray[np.int64],
    visits: NDArray[np.int64],
) -> None:
    """Run every episode of trees `first_tree` to `last_tree - 1`, filling their rows of `returns` and `lengths`.

    Children must follow their parents in the arrays, as the mapping and the simplification number them; where
    visits are counted any order will do.

    Args:
        dynamics: Branch of `advance`.
        starts: [E, START_ROWS], the episodes' first states and observations.
        max_episode_steps: Truncation.
        forest: The trees; an individual without a tree is passed over.
        first_tree: First tree to run.
        last_tree: One past the last tree to run.
        returns: [P, E] float64, written; rows of individuals without a tree stay as they are.
        lengths: [P, E] int64, written likewise.
        visits: [M] int64, increased by the visits of each node, or [0] to count none.
    """
    work = _Work(starts, max_episode_steps, returns, lengths, visits)
    if len(starts) < SELECT_MIN_EPISODES or len(visits) > 0:
        _run_trees(dynamics, work, forest, first_tree, last_tree, False)
        return
    for tree in range(first_tree, last_tree):
        by_selects = forest.offsets[tree + 1] - forest.offsets[tree] <= SELECT_MAX_NODES
        _run_trees(dynamics, work, forest, tree, tree + 1, by_selects)
