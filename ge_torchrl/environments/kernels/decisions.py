"""What lanes do next: a tree's answer to what each lane observes, in ways that give the same answer (law 4).

Where many episodes of one tree run side by side, its splits are evaluated bottom-up as vector selects: every split for
every lane, no branch. Where lanes hold different trees, or a tree is large, every lane walks its tree. Both ways are
there twice: for axis-aligned trees with actions, and for all trees, whose splits and leaves may be weighted sums.

Values are rounded to float32, then clipped to the bounds of the environment's actions.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import compiled, inlined
from ge_torchrl.environments.kernels.lanes import ACTION, LANES, OBSERVATION, to_float32
from ge_torchrl.trees.forest import ForestArrays


class Lanes(NamedTuple):
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


@compiled
def leaf_values(forest: ForestArrays, tree: int, as_numbers: bool) -> NDArray[np.float64]:
    """Return [(M + L) * LANES], in every lane the actions of a tree's leaves, or their numbers."""
    n_splits = forest.split_start[tree + 1] - forest.split_start[tree]
    first, last = forest.leaf_start[tree], forest.leaf_start[tree + 1]
    values = np.zeros((n_splits + last - first) * LANES)
    for leaf in range(last - first):
        at = (n_splits + leaf) * LANES
        if as_numbers:
            values[at : at + LANES] = leaf
        elif forest.value.shape[1] == 0:
            values[at : at + LANES] = forest.action[first + leaf]
    return values


@inlined
def decide_by_selects(
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
def clipped(value: float, bounds: NDArray[np.float64], entry: int) -> float:
    """Return an entry of an action as the environment is given it: rounded to float32, within its bounds."""
    return float(min(max(to_float32(value), bounds[0, entry]), bounds[1, entry]))


@inlined
def answer_values(
    rows: NDArray[np.float64], lane: int, forest: ForestArrays, leaf: int, bounds: NDArray[np.float64]
) -> None:
    """Set a lane's ACTION to a leaf's values, summed in float64 in the order constant, terms."""
    for entry in range(forest.value.shape[1]):
        total = float(forest.value[leaf, entry])
        for term in range(forest.leaf_term_start[leaf], forest.leaf_term_start[leaf + 1]):
            observed = rows[OBSERVATION + forest.leaf_feature[term] * LANES + lane]
            total += np.float64(forest.leaf_weight[term, entry]) * observed
        rows[ACTION + entry * LANES + lane] = clipped(total, bounds, entry)


@inlined
def answer(
    rows: NDArray[np.float64],
    lane: int,
    forest: ForestArrays,
    leaf: int,
    bounds: NDArray[np.float64],
    leaf_visits: NDArray[np.int64],
) -> None:
    """Set a lane's ACTION to a leaf's answer, and count the visit."""
    if len(leaf_visits) > 0:
        leaf_visits[leaf] += 1
    if forest.value.shape[1] == 0:
        rows[ACTION + lane] = forest.action[leaf]
    else:
        answer_values(rows, lane, forest, leaf, bounds)


@inlined
def evaluate_leaves(
    rows: NDArray[np.float64],
    values: NDArray[np.float64],
    forest: ForestArrays,
    tree: int,
    bounds: NDArray[np.float64],
) -> None:
    """Write the one value of each leaf of a tree, in each lane, behind the splits in `values`; see `leaf_values`."""
    lanes = np.uint64(LANES)
    n_splits = forest.split_start[tree + 1] - forest.split_start[tree]
    first, last = forest.leaf_start[tree], forest.leaf_start[tree + 1]
    low, high = bounds[0, 0], bounds[1, 0]
    for leaf in range(first, last):
        at = np.uint64(n_splits + leaf - first) * lanes
        constant = np.float64(forest.value[leaf, 0])
        for i in range(lanes):
            values[at + i] = constant
        for term in range(forest.leaf_term_start[leaf], forest.leaf_term_start[leaf + 1]):
            observed = np.uint64(OBSERVATION) + np.uint64(forest.leaf_feature[term]) * lanes
            weight = np.float64(forest.leaf_weight[term, 0])
            for i in range(lanes):
                values[at + i] += weight * rows[observed + i]
        for i in range(lanes):
            values[at + i] = min(max(to_float32(values[at + i]), low), high)


@inlined
def decide_by_selects_of_sums(
    rows: NDArray[np.float64], values: NDArray[np.float64], forest: ForestArrays, tree: int
) -> None:
    """Do what `decide_by_selects` does, where splits may be weighted sums.

    Sums stand in ACTION until their split has answered. In `values`, where the answers come, LLVM would not vectorise.
    """
    lanes = np.uint64(LANES)
    first = forest.split_start[tree]
    n_splits = forest.split_start[tree + 1] - first
    for split in range(n_splits - 1, -1, -1):
        row = first + split
        at = np.uint64(split) * lanes
        first_term, last_term = forest.term_start[row], forest.term_start[row + 1]
        for term in range(first_term, last_term):
            observed = np.uint64(OBSERVATION) + np.uint64(forest.feature[term]) * lanes
            weight = np.float64(forest.weight[term])
            if term == first_term:
                for i in range(lanes):
                    rows[np.uint64(ACTION) + i] = weight * rows[observed + i]
            else:
                for i in range(lanes):
                    rows[np.uint64(ACTION) + i] += weight * rows[observed + i]
        limit = np.float64(forest.threshold[row])
        left_child, right_child = np.int64(forest.children_left[row]), np.int64(forest.children_right[row])
        left = np.uint64(left_child if left_child >= 0 else n_splits + ~left_child) * lanes
        right = np.uint64(right_child if right_child >= 0 else n_splits + ~right_child) * lanes
        for i in range(lanes):
            if_true, if_false = values[left + i], values[right + i]
            values[at + i] = if_true if rows[np.uint64(ACTION) + i] < limit else if_false
    for i in range(lanes):
        rows[np.uint64(ACTION) + i] = values[i]


@inlined
def look_up_answers(
    rows: NDArray[np.float64],
    forest: ForestArrays,
    tree: int,
    bounds: NDArray[np.float64],
    leaf_visits: NDArray[np.int64],
    n: int,
) -> None:
    """Put the answers of the leaves whose numbers stand in ACTION there, and count the visits."""
    for i in range(n):
        leaf = forest.leaf_start[tree] + np.int64(rows[ACTION + i])
        answer(rows, i, forest, leaf, bounds, leaf_visits)


@inlined
def look_up_actions(
    rows: NDArray[np.float64], forest: ForestArrays, tree: int, leaf_visits: NDArray[np.int64], n: int
) -> None:
    """Count the leaves whose numbers stand in ACTION, and put their actions there."""
    for i in range(n):
        leaf = forest.leaf_start[tree] + np.int64(rows[ACTION + i])
        leaf_visits[leaf] += 1
        rows[ACTION + i] = forest.action[leaf]


@inlined
def decide_by_walks(lanes: Lanes, forest: ForestArrays, leaf_visits: NDArray[np.int64], n: int) -> None:
    """Set every lane's ACTION by walking the lane's own tree; all trees are axis-aligned and hold actions."""
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
def decide_by_sums(
    lanes: Lanes, forest: ForestArrays, bounds: NDArray[np.float64], leaf_visits: NDArray[np.int64], n: int
) -> None:
    """Set every lane's ACTION by walking the lane's own tree, of any kind."""
    for i in range(n):
        node = lanes.root[i]
        while node >= 0:
            row = lanes.split_start[i] + node
            is_left = goes_left(lanes.rows, i, forest, row)
            node = np.int64(forest.children_left[row] if is_left else forest.children_right[row])
        answer(lanes.rows, i, forest, lanes.leaf_start[i] + ~node, bounds, leaf_visits)


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
