"""Fused rollouts: reset, tree, physics, reward and termination of many episodes in one compiled loop."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import compiled, inlined
from ge_torchrl.environments.kernels.decisions import (
    Lanes,
    are_axis_aligned,
    decide_by_selects,
    decide_by_selects_of_sums,
    decide_by_sums,
    decide_by_walks,
    evaluate_leaves,
    leaf_values,
    look_up_actions,
    look_up_answers,
)
from ge_torchrl.environments.kernels.dynamics import advance
from ge_torchrl.environments.kernels.lanes import LANE_ROWS, LANES, REWARD, TERMINATED
from ge_torchrl.trees.forest import ForestArrays

# Below these a bottom-up evaluation of all splits is cheaper than walks (measured by the benchmarks).
SELECT_MAX_SPLITS = 31
SELECT_MAX_SUMMED = 64
SELECT_MIN_EPISODES = 24

_WALKS, _SELECTS, _WALKS_OVER_SUMS, _SELECTS_OVER_SUMS = 0, 1, 2, 3


class _Work(NamedTuple):
    """What is to be run, and where its results go; see `run_forest`."""

    max_episode_steps: int
    starts: NDArray[np.float64]
    bounds: NDArray[np.float64]
    first_episode: int
    last_episode: int
    returns: NDArray[np.float64]
    lengths: NDArray[np.int64]
    leaf_visits: NDArray[np.int64]


@inlined
def _next_tree(forest: ForestArrays, tree: int, last_tree: int) -> int:
    """Return the first individual from `tree` on that has a tree, `last_tree` if none has."""
    while tree < last_tree and forest.leaf_start[tree + 1] == forest.leaf_start[tree]:
        tree += 1
    return tree


@inlined
def _start_episode(
    lanes: Lanes, i: int, work: _Work, forest: ForestArrays, tree: int, episode: int, last_tree: int
) -> tuple[int, int]:
    """Begin an episode of a tree in lane `i`; return the tree and the episode that come next."""
    lanes.tree[i] = tree
    lanes.episode[i] = episode
    lanes.split_start[i] = forest.split_start[tree]
    lanes.leaf_start[i] = forest.leaf_start[tree]
    lanes.root[i] = 0 if forest.split_start[tree + 1] > forest.split_start[tree] else -1
    lanes.total[i] = 0.0
    lanes.steps[i] = 0
    for row in range(work.starts.shape[1]):
        lanes.rows[row * LANES + i] = work.starts[episode, row]
    if episode + 1 < work.last_episode:
        return tree, episode + 1
    return _next_tree(forest, tree + 1, last_tree), work.first_episode


@inlined
def _count_step(lanes: Lanes, max_episode_steps: int, n: int) -> int:
    """Add the step's reward and length to each lane; return how many lanes ended."""
    n_ended = 0
    for i in range(n):
        lanes.total[i] += lanes.rows[REWARD + i]
        lanes.steps[i] += 1
        n_ended += (lanes.rows[TERMINATED + i] != 0.0) | (lanes.steps[i] >= max_episode_steps)
    return n_ended


@inlined
def _move_lane(lanes: Lanes, source: int, target: int, n_rows: int) -> None:
    # The rest is written anew before it is read.
    for row in range(n_rows):
        lanes.rows[row * LANES + target] = lanes.rows[row * LANES + source]
    lanes.total[target] = lanes.total[source]
    lanes.steps[target] = lanes.steps[source]
    lanes.tree[target] = lanes.tree[source]
    lanes.episode[target] = lanes.episode[source]
    lanes.root[target] = lanes.root[source]
    lanes.split_start[target] = lanes.split_start[source]
    lanes.leaf_start[target] = lanes.leaf_start[source]


@compiled
def _decide_any(
    lanes: Lanes, values: NDArray[np.float64], work: _Work, forest: ForestArrays, tree: int, n: int
) -> None:
    """Set the ACTION of the first `n` lanes, of trees of any kind; by selects where there are `values`, of one tree.

    A function of its own: its arrays would be counted in the loop of axis-aligned trees too.
    """
    if len(values) == 0:
        decide_by_sums(lanes, forest, work.bounds, work.leaf_visits, n)
        return
    by_number = _by_number(forest, work)
    if forest.value.shape[1] > 0 and not by_number:
        evaluate_leaves(lanes.rows, values, forest, tree, work.bounds)
    decide_by_selects_of_sums(lanes.rows, values, forest, tree)
    if by_number:
        look_up_answers(lanes.rows, forest, tree, work.bounds, work.leaf_visits, n)


@inlined
def _by_number(forest: ForestArrays, work: _Work) -> bool:
    """Tell whether leaves are selected by number: to be counted, or since each holds several values."""
    return len(work.leaf_visits) > 0 or forest.value.shape[1] > 1


@compiled
def _run_trees(
    dynamics: int, work: _Work, forest: ForestArrays, first_tree: int, last_tree: int, way: int
) -> int:
    """Run the episodes of trees `first_tree` to `last_tree - 1`, by selects one tree; return the number of steps.

    A lane that ends takes the next episode; when none is left the last running lane moves into its place.
    """
    lanes = Lanes(
        np.zeros(LANE_ROWS * LANES),
        np.zeros(LANES),
        np.zeros(LANES, np.int64),
        np.zeros(LANES, np.int64),
        np.zeros(LANES, np.int64),
        np.zeros(LANES, np.int64),
        np.zeros(LANES, np.int64),
        np.zeros(LANES, np.int64),
    )
    counting, selecting = len(work.leaf_visits) > 0, way in (_SELECTS, _SELECTS_OVER_SUMS)
    values = leaf_values(forest, first_tree, _by_number(forest, work)) if selecting else np.zeros(0)
    tree, episode, n = _next_tree(forest, first_tree, last_tree), work.first_episode, 0
    n_steps = 0
    while n < LANES and tree < last_tree:
        tree, episode = _start_episode(lanes, n, work, forest, tree, episode, last_tree)
        n += 1
    while n > 0:
        if way == _SELECTS:
            decide_by_selects(lanes.rows, values, forest, first_tree)
            if counting:
                look_up_actions(lanes.rows, forest, first_tree, work.leaf_visits, n)
        elif way == _WALKS:
            decide_by_walks(lanes, forest, work.leaf_visits, n)
        else:
            _decide_any(lanes, values, work, forest, first_tree, n)
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
                    _move_lane(lanes, n, i, work.starts.shape[1])
    return n_steps


@inlined
def _way(forest: ForestArrays, tree: int) -> int:
    """Return the quickest way to decide where many episodes of one tree run side by side."""
    first_split, last_split = forest.split_start[tree], forest.split_start[tree + 1]
    n_splits = last_split - first_split
    if forest.value.shape[1] > 0 or not are_axis_aligned(forest, first_split, last_split):
        n_terms = forest.term_start[last_split] - forest.term_start[first_split]
        first_leaf, last_leaf = forest.leaf_start[tree], forest.leaf_start[tree + 1]
        n_terms += forest.leaf_term_start[last_leaf] - forest.leaf_term_start[first_leaf]
        return _SELECTS_OVER_SUMS if n_splits + n_terms <= SELECT_MAX_SUMMED else _WALKS_OVER_SUMS
    if n_splits <= SELECT_MAX_SPLITS:
        return _SELECTS
    # Walks take terms as numbered as splits are.
    return _WALKS if forest.term_start[first_split] == first_split else _WALKS_OVER_SUMS


@compiled
def run_forest(
    forest: ForestArrays,
    dynamics: int,
    max_episode_steps: int,
    starts: NDArray[np.float64],
    bounds: NDArray[np.float64],
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
        forest: The trees; an individual without a tree is passed over.
        dynamics: What `advance` takes.
        max_episode_steps: Truncation.
        starts: [E, S], the episodes' first states and observations.
        bounds: [2, A], lowest and highest float32 value of each entry of an action; [2, 0] where leaves hold actions.
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
    work = _Work(
        max_episode_steps, starts, bounds, first_episode, last_episode, returns, lengths, leaf_visits
    )
    if last_episode - first_episode < SELECT_MIN_EPISODES:
        # Terms are numbered as splits are only where all trees in front are axis-aligned as well.
        aligned = forest.value.shape[1] == 0 and are_axis_aligned(forest, 0, forest.split_start[last_tree])
        way = _WALKS if aligned else _WALKS_OVER_SUMS
        return _run_trees(dynamics, work, forest, first_tree, last_tree, way)
    n_steps = 0
    for tree in range(first_tree, last_tree):
        n_steps += _run_trees(dynamics, work, forest, tree, tree + 1, _way(forest, tree))
    return n_steps
