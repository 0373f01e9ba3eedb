"""The compiled walk that keeps of trees what observations within bounds can reach."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import compiled
from ge_torchrl.trees.arrays import FloatArray, ForestArrays, IntArray

# What a split says of all observations that come to it.
_OPEN, _TRUE, _FALSE = 0, 1, 2


class Box(NamedTuple):
    """What observations are possible: feature `f` lies in `[least[f], bound[f])`, and never above `greatest[f]`."""

    least: FloatArray
    bound: FloatArray
    greatest: FloatArray


class _Path(NamedTuple):
    """The splits that were written between the root and the walk, by depth."""

    row: NDArray[np.int64]
    feature: IntArray  # What the split compares, -1 for a sum.
    end: FloatArray  # The end of the feature's interval to put back.
    in_right: NDArray[np.bool_]
    other: IntArray  # The right child, as the old tree numbers it.
    left_leaf: NDArray[np.int64]  # Where the left half's leaves begin; its splits follow the row.
    right_split: NDArray[np.int64]
    right_leaf: NDArray[np.int64]


@compiled
def keep_what_is_reached(trees: ForestArrays, box: Box) -> ForestArrays:
    """Walk every tree once, depth first, and write the splits and leaves that matter; leaves hold actions."""
    # Splits, leaves and terms that were written.
    out, ends = _empty_like(trees), np.zeros(3, np.int64)
    path = _empty_path(len(trees.threshold) + 1)
    has_sums = len(trees.feature) > len(trees.threshold) or np.any(trees.weight != 1.0)
    for p in range(len(trees.split_start) - 1):
        first, first_leaf, depth = ends[0], ends[1], 0
        walking = trees.leaf_start[p + 1] > trees.leaf_start[p]
        node = 0 if trees.split_start[p + 1] > trees.split_start[p] else -1
        while walking:
            while node >= 0:
                m = trees.split_start[p] + node
                outcome = _outcome(trees, m, box)
                if has_sums and outcome == _OPEN:
                    outcome = _outcome_of_path(trees, m, out, path, depth)
                if outcome == _OPEN:
                    _write_split(trees, m, out, ends)
                    path.other[depth], path.left_leaf[depth] = trees.children_right[m], ends[1]
                    _go_left(out, ends[0] - 1, path, depth, box)
                    depth += 1
                node = trees.children_right[m] if outcome == _FALSE else trees.children_left[m]
            out.action[ends[1]] = trees.action[trees.leaf_start[p] + ~node]
            done = ~(ends[1] - first_leaf)
            ends[1] += 1
            while depth > 0 and path.in_right[depth - 1]:
                depth -= 1
                row = path.row[depth]
                if path.feature[depth] >= 0:
                    box.least[path.feature[depth]] = path.end[depth]
                out.children_right[row] = done
                done = row - first
                if _are_halves_equal(out, ends, path, depth):
                    done = out.children_left[row] if out.children_left[row] < 0 else done
                    _keep_left_half(out, ends, path, depth)
            walking = depth > 0
            if walking:
                out.children_left[path.row[depth - 1]] = done
                _turn_right(out, ends, path, depth - 1, box)
                node = path.other[depth - 1]
        out.split_start[p + 1], out.leaf_start[p + 1] = ends[0], ends[1]
    return _cut(out, ends)


@compiled
def _go_left(out: ForestArrays, row: int, path: _Path, depth: int, box: Box) -> None:
    k = out.term_start[row]
    f = out.feature[k] if out.term_start[row + 1] == k + 1 and out.weight[k] == 1.0 else np.int32(-1)
    path.row[depth], path.feature[depth], path.in_right[depth] = row, f, False
    if f >= 0:
        path.end[depth], box.bound[f] = box.bound[f], out.threshold[row]


@compiled
def _turn_right(out: ForestArrays, ends: NDArray[np.int64], path: _Path, depth: int, box: Box) -> None:
    path.in_right[depth], path.right_split[depth], path.right_leaf[depth] = True, ends[0], ends[1]
    f = path.feature[depth]
    if f >= 0:
        box.bound[f], path.end[depth] = path.end[depth], box.least[f]
        box.least[f] = out.threshold[path.row[depth]]


@compiled
def _outcome(trees: ForestArrays, m: int, box: Box) -> int:
    """Return what split `m` says of all observations in the box, `_OPEN` where that is not known.

    The lower end of a feature's interval always belongs to it, so a split on one feature is open exactly where
    `least < threshold < bound`: the least value goes left, the threshold itself right.
    """
    k, t = trees.term_start[m], trees.threshold[m]
    if trees.term_start[m + 1] == k + 1 and trees.weight[k] == 1.0:
        f = trees.feature[k]
        if not box.least[f] < t:
            return _FALSE
        return _OPEN if t < box.bound[f] else _TRUE
    return _outcome_of_sum(trees, m, box)


@compiled
def _outcome_of_path(trees: ForestArrays, m: int, out: ForestArrays, path: _Path, depth: int) -> int:
    """Return what split `m` says of all observations that came along a path, if its sum was compared there before."""
    for above in range(depth):
        row = path.row[above]
        if path.feature[above] < 0 and _have_same_terms(trees, m, out, row):
            # What is not below a threshold is not below a lower one either, NaN included.
            if path.in_right[above] and trees.threshold[m] <= out.threshold[row]:
                return _FALSE
            if not path.in_right[above] and trees.threshold[m] >= out.threshold[row]:
                return _TRUE
    return _OPEN


@compiled
def _have_same_terms(trees: ForestArrays, m: int, others: ForestArrays, n: int) -> bool:
    first, other = trees.term_start[m], others.term_start[n]
    n_terms = trees.term_start[m + 1] - first
    if others.term_start[n + 1] - other != n_terms:
        return False
    for i in range(n_terms):
        k, j = first + i, other + i
        if trees.feature[k] != others.feature[j] or trees.weight[k] != others.weight[j]:
            return False
    return True


@compiled
def _write_split(trees: ForestArrays, m: int, out: ForestArrays, ends: NDArray[np.int64]) -> None:
    """Write split `m` behind the last one, without children."""
    for k in range(trees.term_start[m], trees.term_start[m + 1]):
        out.feature[ends[2]], out.weight[ends[2]] = trees.feature[k], trees.weight[k]
        ends[2] += 1
    out.threshold[ends[0]] = trees.threshold[m]
    ends[0] += 1
    out.term_start[ends[0]] = ends[2]


@compiled
def _empty_path(capacity: int) -> _Path:
    return _Path(
        row=np.empty(capacity, np.int64),
        feature=np.empty(capacity, np.int32),
        end=np.empty(capacity, np.float32),
        in_right=np.empty(capacity, np.bool_),
        other=np.empty(capacity, np.int32),
        left_leaf=np.empty(capacity, np.int64),
        right_split=np.empty(capacity, np.int64),
        right_leaf=np.empty(capacity, np.int64),
    )


@compiled
def _empty_like(trees: ForestArrays) -> ForestArrays:
    return ForestArrays(
        np.zeros_like(trees.split_start),
        np.zeros_like(trees.leaf_start),
        np.zeros_like(trees.term_start),
        np.empty_like(trees.feature),
        np.empty_like(trees.weight),
        np.empty_like(trees.threshold),
        np.empty_like(trees.children_left),
        np.empty_like(trees.children_right),
        np.empty_like(trees.action),
        trees.value,
        trees.leaf_term_start,
        trees.leaf_feature,
        trees.leaf_weight,
    )


@compiled
def _cut(trees: ForestArrays, ends: NDArray[np.int64]) -> ForestArrays:
    """Return the first splits, leaves and terms."""
    return ForestArrays(
        trees.split_start,
        trees.leaf_start,
        trees.term_start[: ends[0] + 1].copy(),
        trees.feature[: ends[2]].copy(),
        trees.weight[: ends[2]].copy(),
        trees.threshold[: ends[0]].copy(),
        trees.children_left[: ends[0]].copy(),
        trees.children_right[: ends[0]].copy(),
        trees.action[: ends[1]].copy(),
        trees.value[: ends[1]].copy(),
        trees.leaf_term_start[: ends[1] + 1].copy(),
        trees.leaf_feature.copy(),
        trees.leaf_weight.copy(),
    )


@compiled
def _outcome_of_sum(trees: ForestArrays, m: int, box: Box) -> int:
    """Return what a split on a sum says of all observations in the box, `_OPEN` where that is not known."""
    t = trees.threshold[m]
    # Rounding keeps order, so the sum of the least terms, added in their order, is the least sum. Infinite entries
    # may give NaN, which every comparison denies: then the split stays.
    least, greatest = 0.0, 0.0
    for k in range(trees.term_start[m], trees.term_start[m + 1]):
        f, w = trees.feature[k], np.float64(trees.weight[k])
        if w == 0.0:
            continue
        is_narrowed = box.bound[f] <= box.greatest[f] and box.bound[f] < np.inf
        top = np.nextafter(box.bound[f], np.float32(-np.inf)) if is_narrowed else box.greatest[f]
        one_end, other_end = w * np.float64(box.least[f]), w * np.float64(top)
        least += one_end if w > 0 else other_end
        greatest += other_end if w > 0 else one_end
    if greatest < t and least <= greatest:
        return _TRUE
    if least >= t and least <= greatest:
        return _FALSE
    return _OPEN


@compiled
def _are_halves_equal(out: ForestArrays, ends: NDArray[np.int64], path: _Path, depth: int) -> bool:
    """Tell whether both halves of a split, the last that were written, are the same."""
    row, left_leaf = path.row[depth], path.left_leaf[depth]
    right_split, right_leaf = path.right_split[depth], path.right_leaf[depth]
    n_splits, n_leaves = right_split - row - 1, right_leaf - left_leaf
    if ends[0] - right_split != n_splits:
        return False
    for leaf in range(left_leaf, right_leaf):
        if out.action[leaf] != out.action[leaf + n_leaves]:
            return False
    for m in range(row + 1, right_split):
        n = m + n_splits
        # Depth first, left children alone fix the shape.
        child = out.children_left[m] + (n_splits if out.children_left[m] >= 0 else -n_leaves)
        if (
            out.threshold[m] != out.threshold[n]
            or out.children_left[n] != child
            or not _have_same_terms(out, m, out, n)
        ):
            return False
    return True


@compiled
def _keep_left_half(out: ForestArrays, ends: NDArray[np.int64], path: _Path, depth: int) -> None:
    """Put the left half of a split in its place and forget the right one."""
    row, right_split, right_leaf = path.row[depth], path.right_split[depth], path.right_leaf[depth]
    first_term, n_terms = out.term_start[row], out.term_start[row + 1] - out.term_start[row]
    for k in range(first_term + n_terms, out.term_start[right_split]):
        out.feature[k - n_terms], out.weight[k - n_terms] = out.feature[k], out.weight[k]
    for m in range(row + 1, right_split):
        out.threshold[m - 1] = out.threshold[m]
        left, right = out.children_left[m], out.children_right[m]
        out.children_left[m - 1] = left - 1 if left >= 0 else left
        out.children_right[m - 1] = right - 1 if right >= 0 else right
        out.term_start[m] = out.term_start[m + 1] - n_terms
    ends[0], ends[1], ends[2] = right_split - 1, right_leaf, out.term_start[right_split - 1]
