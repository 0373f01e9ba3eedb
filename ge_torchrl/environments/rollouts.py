"""Fused rollouts: reset, tree, physics, reward and termination of many episodes in one compiled loop.

Three ways to decide, the same answer (law 4). Where many episodes of one tree run side by side, its splits are
evaluated bottom-up as vector selects: every split for every lane, no branch. Where lanes hold different trees, or a
tree is large, every lane walks its tree. Where splits are weighted sums, lanes walk too, and add up on the way.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import compiled, inlined
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

# Below these a bottom-up evaluation of all splits is cheaper than walks (measured by the benchmarks).
SELECT_MAX_SPLITS = 31
SELECT_MIN_EPISODES = 24

_WALKS, _SELECTS, _WALKS_OVER_SUMS = 0, 1, 2


class _Work(NamedTuple):
    """What is to be run, and where its results go; see `run_forest`."""

    max_episode_steps: int
    starts: NDArray[np.float64]
    first_episode: int
    last_episode: int
    returns: NDArray[np.float64]
    lengths: NDArray[np.int64]
    leaf_visits: NDArray[np.int64]


class _Lanes(NamedTuple):
    """The running episodes, one a lane.

    Attributes:
        rows: [LANE_ROWS * LANES] float64, as `dynamics` lays them out.
        total: [LANES] float64, the return so far.
        steps: [LANES] int64, steps so far.
        tree: [LANES] int64, whose episode it is.
        episode: [LANES] int64, which episode it is.
        root: [LANES] int64, split 0 of the tree, or leaf 0 as `~0`.
        split_start: [LANES] int64, the tree's first row among splits.
        leaf_start: [LANES] int64, the tree's first row among leaves.
    """

    rows: NDArray[np.float64]
    total: NDArray[np.float64]
    steps: NDArray[np.int64]
    tree: NDArray[np.int64]
    episode: NDArray[np.int64]
    root: NDArray[np.int64]
    split_start: NDArray[np.int64]
    leaf_start: NDArray[np.int64]


@inlined
def _decide_by_selects(
    rows: NDArray[np.float64], values: NDArray[np.float64], forest: ForestArrays, tree: int
) -> None:
    """Set every lane's ACTION, empty lanes' too, by evaluating one tree bottom-up.

    `values` [(M + L) * LANES] holds the answer of each split in each lane, and behind them those of leaves, which are
    there already. Children follow their parents.
    """
    # Unsigned indices: LLVM then sees that none counts from the end, and vectorises.
    lanes = np.uint64(LANES)
    first = forest.split_start[tree]
    n_splits = forest.split_start[tree + 1] - first
    for split in range(n_splits - 1, -1, -1):
        row = first + split
        observed = np.uint64(OBSERVATION) + np.uint64(forest.feature[forest.term_start[row]]) * lanes
        limit = np.float64(forest.threshold[row])
        left_child, right_child = np.int64(forest.children_left[row]), np.int64(forest.children_right[row])
        left = np.uint64(left_child if left_child >= 0 else n_splits + ~left_child) * lanes
        right = np.uint64(right_child if right_child >= 0 else n_splits + ~right_child) * lanes
        answer = np.uint64(split) * lanes
        for i in range(lanes):
            # Both are read whatever the answer: a select has no branch.
            if_true, if_false = values[left + i], values[right + i]
            values[answer + i] = if_true if rows[observed + i] < limit else if_false
    for i in range(lanes):
        rows[np.uint64(ACTION) + i] = values[i]


@inlined
def _look_up_actions(
    rows: NDArray[np.float64], forest: ForestArrays, tree: int, leaf_visits: NDArray[np.int64], n: int
) -> None:
    """Count the leaves whose numbers stand in ACTION, and put their actions there."""
    for i in range(n):
        leaf = forest.leaf_start[tree] + np.int64(rows[ACTION + i])
        leaf_visits[leaf] += 1
        rows[ACTION + i] = forest.action[leaf]


@inlined
def _decide_by_walks(lanes: _Lanes, forest: ForestArrays, leaf_visits: NDArray[np.int64], n: int) -> None:
    """Set every lane's ACTION by walking the lane's own tree; all trees are axis-aligned."""
    counting = len(leaf_visits) > 0
    for i in range(n):
        split_start = lanes.split_start[i]
        node = lanes.root[i]
        while node >= 0:
            row = split_start + node
            # Every split has one term, so terms are numbered as splits are.
            is_left = lanes.rows[OBSERVATION + forest.feature[row] * LANES + i] < forest.threshold[row]
            node = np.int64(forest.children_left[row] if is_left else forest.children_right[row])
        leaf = lanes.leaf_start[i] + ~node
        if counting:
            leaf_visits[leaf] += 1
        lanes.rows[ACTION + i] = forest.action[leaf]


@inlined
def goes_left(rows: NDArray[np.float64], lane: int, forest: ForestArrays, row: int) -> bool:
    """Tell whether a lane's weighted sum, in float64 and in the order of its terms, is below the threshold."""
    total = 0.0
    for term in range(forest.term_start[row], forest.term_start[row + 1]):
        total += np.float64(forest.weight[term]) * rows[OBSERVATION + forest.feature[term] * LANES + lane]
    return bool(total < forest.threshold[row])


@inlined
def _decide_by_sums(lanes: _Lanes, forest: ForestArrays, leaf_visits: NDArray[np.int64], n: int) -> None:
    """Set every lane's ACTION by walking the lane's own tree, whose splits may be weighted sums."""
    counting = len(leaf_visits) > 0
    for i in range(n):
        node = lanes.root[i]
        while node >= 0:
            row = lanes.split_start[i] + node
            is_left = goes_left(lanes.rows, i, forest, row)
            node = np.int64(forest.children_left[row] if is_left else forest.children_right[row])
        leaf = lanes.leaf_start[i] + ~node
        if counting:
            leaf_visits[leaf] += 1
        lanes.rows[ACTION + i] = forest.action[leaf]


@compiled
def are_axis_aligned(forest: ForestArrays, first_split: int, last_split: int) -> bool:
    """Tell whether each of these splits has one term of weight 1."""
    first, last = forest.term_start[first_split], forest.term_start[last_split]
    if last - first != last_split - first_split:
        return False
    all_ones = True
    for term in range(first, last):
        all_ones &= forest.weight[term] == np.float32(1.0)
    return all_ones


@inlined
def _next_tree(forest: ForestArrays, tree: int, last_tree: int) -> int:
    """Return the first individual from `tree` on that has a tree, `last_tree` if none has."""
    while tree < last_tree and forest.leaf_start[tree + 1] == forest.leaf_start[tree]:
        tree += 1
    return tree


@inlined
def _start_episode(
    lanes: _Lanes, i: int, work: _Work, forest: ForestArrays, tree: int, episode: int, last_tree: int
) -> tuple[int, int]:
    """Begin an episode of a tree in lane `i`; return the tree and the episode that come next."""
    lanes.tree[i] = tree
    lanes.episode[i] = episode
    lanes.split_start[i] = forest.split_start[tree]
    lanes.leaf_start[i] = forest.leaf_start[tree]
    lanes.root[i] = 0 if forest.split_start[tree + 1] > forest.split_start[tree] else -1
    lanes.total[i] = 0.0
    lanes.steps[i] = 0
    for row in range(START_ROWS):
        lanes.rows[row * LANES + i] = work.starts[episode, row]
    if episode + 1 < work.last_episode:
        return tree, episode + 1
    return _next_tree(forest, tree + 1, last_tree), work.first_episode


@inlined
def _count_step(lanes: _Lanes, max_episode_steps: int, n: int) -> int:
    """Add the step's reward and length to each lane; return how many lanes ended."""
    n_ended = 0
    for i in range(n):
        lanes.total[i] += lanes.rows[REWARD + i]
        lanes.steps[i] += 1
        n_ended += (lanes.rows[TERMINATED + i] != 0.0) | (lanes.steps[i] >= max_episode_steps)
    return n_ended


@inlined
def _move_lane(lanes: _Lanes, source: int, target: int) -> None:
    for row in range(LANE_ROWS):
        lanes.rows[row * LANES + target] = lanes.rows[row * LANES + source]
    lanes.total[target] = lanes.total[source]
    lanes.steps[target] = lanes.steps[source]
    lanes.tree[target] = lanes.tree[source]
    lanes.episode[target] = lanes.episode[source]
    lanes.root[target] = lanes.root[source]
    lanes.split_start[target] = lanes.split_start[source]
    lanes.leaf_start[target] = lanes.leaf_start[source]


@compiled
def _leaf_values(forest: ForestArrays, tree: int, as_numbers: bool) -> NDArray[np.float64]:
    """Return [(M + L) * LANES], in every lane the actions of a tree's leaves, or their numbers."""
    n_splits = forest.split_start[tree + 1] - forest.split_start[tree]
    first, last = forest.leaf_start[tree], forest.leaf_start[tree + 1]
    values = np.zeros((n_splits + last - first) * LANES)
    for leaf in range(last - first):
        at = (n_splits + leaf) * LANES
        values[at : at + LANES] = leaf if as_numbers else forest.action[first + leaf]
    return values


@compiled
def _run_trees(
    dynamics: int, work: _Work, forest: ForestArrays, first_tree: int, last_tree: int, way: int
) -> int:
    """Run the episodes of trees `first_tree` to `last_tree - 1`, by selects one tree; return the number of steps.

    A lane that ends takes the next episode; when none is left the last running lane moves into its place.
    """
    lanes = _Lanes(
        np.zeros(LANE_ROWS * LANES),
        np.zeros(LANES),
        np.zeros(LANES, np.int64),
        np.zeros(LANES, np.int64),
        np.zeros(LANES, np.int64),
        np.zeros(LANES, np.int64),
        np.zeros(LANES, np.int64),
        np.zeros(LANES, np.int64),
    )
    counting = len(work.leaf_visits) > 0
    values = _leaf_values(forest, first_tree, counting) if way == _SELECTS else np.zeros(0)
    tree, episode, n = _next_tree(forest, first_tree, last_tree), work.first_episode, 0
    n_steps = 0
    while n < LANES and tree < last_tree:
        tree, episode = _start_episode(lanes, n, work, forest, tree, episode, last_tree)
        n += 1
    while n > 0:
        if way == _SELECTS:
            _decide_by_selects(lanes.rows, values, forest, first_tree)
            if counting:
                _look_up_actions(lanes.rows, forest, first_tree, work.leaf_visits, n)
        elif way == _WALKS:
            _decide_by_walks(lanes, forest, work.leaf_visits, n)
        else:
            _decide_by_sums(lanes, forest, work.leaf_visits, n)
        advance(dynamics, lanes.rows, n)
        n_steps += n
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
    return n_steps


@compiled
def run_forest(
    forest: ForestArrays,
    dynamics: int,
    max_episode_steps: int,
    starts: NDArray[np.float64],
    first_tree: int,
    last_tree: int,
    first_episode: int,
    last_episode: int,
    returns: NDArray[np.float64],
    lengths: NDArray[np.int64],
    leaf_visits: NDArray[np.int64],
) -> int:
    """Run some episodes of some trees, filling their places in `returns` and `lengths`.

    Args:
        forest: The trees, whose leaves hold actions; an individual without a tree is passed over.
        dynamics: Branch of `advance`.
        max_episode_steps: Truncation.
        starts: [E, START_ROWS], the episodes' first states and observations.
        first_tree: First tree to run.
        last_tree: One past the last tree to run.
        first_episode: First episode to run of each tree.
        last_episode: One past the last episode to run.
        returns: [P, E] float64, written; rows of individuals without a tree stay as they are.
        lengths: [P, E] int64, written likewise.
        leaf_visits: [L] int64, increased by the visits of each leaf, or [0] to count none.

    Returns:
        The number of steps.
    """
    # Arrays one by one: a record costs each call from Python three times as long.
    work = _Work(max_episode_steps, starts, first_episode, last_episode, returns, lengths, leaf_visits)
    if last_episode - first_episode < SELECT_MIN_EPISODES:
        # Terms are numbered as splits are only where all trees in front are axis-aligned as well.
        aligned = are_axis_aligned(forest, 0, forest.split_start[last_tree])
        way = _WALKS if aligned else _WALKS_OVER_SUMS
        return _run_trees(dynamics, work, forest, first_tree, last_tree, way)
    n_steps = 0
    for tree in range(first_tree, last_tree):
        first_split, last_split = forest.split_start[tree], forest.split_start[tree + 1]
        if not are_axis_aligned(forest, first_split, last_split):
            way = _WALKS_OVER_SUMS
        elif last_split - first_split <= SELECT_MAX_SPLITS:
            way = _SELECTS
        elif forest.term_start[first_split] == first_split:
            way = _WALKS
        else:
            way = _WALKS_OVER_SUMS
        n_steps += _run_trees(dynamics, work, forest, tree, tree + 1, way)
    return n_steps
