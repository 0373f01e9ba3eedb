"""Sums in their plainest form: fewer terms that say the same of every finite observation, to the last bit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import compiled
from ge_torchrl.trees.arrays import FloatArray, ForestArrays, IntArray


@compiled
def tidied(trees: ForestArrays) -> ForestArrays:
    """Return the trees with plainer sums; their splits are then no more depth first.

    Terms of weight 0 go, since they add 0. The first two terms of a sum become one where they have the same feature
    and their weights add up exactly; behind other terms, rounding would differ. A split on one feature gets weight 1.
    """
    left, right, threshold = trees.children_left.copy(), trees.children_right.copy(), trees.threshold.copy()
    term_start, feature, weight = _terms_that_matter(trees)
    for m in range(len(threshold)):
        k = term_start[m]
        w = np.float64(weight[k])
        if term_start[m + 1] == k + 1 and w not in (0.0, 1.0):
            least = _least_on_the_far_side(w, threshold[m])
            if np.isfinite(least):
                threshold[m], weight[k] = least, 1.0
                if w < 0:
                    left[m], right[m] = right[m], left[m]
    leaf_term_start, leaf_feature, leaf_weight = _leaf_terms_that_matter(trees)
    return ForestArrays(
        trees.split_start,
        trees.leaf_start,
        term_start,
        feature,
        weight,
        threshold,
        left,
        right,
        trees.action,
        trees.value,
        leaf_term_start,
        leaf_feature,
        leaf_weight,
    )


@compiled
def _terms_that_matter(trees: ForestArrays) -> tuple[NDArray[np.int64], IntArray, FloatArray]:
    """Return where the terms of each split begin, their features and their weights; a sum of none is 0 of a feature."""
    term_start = np.zeros_like(trees.term_start)
    feature, weight = np.empty_like(trees.feature), np.empty_like(trees.weight)
    end = 0
    for m in range(len(trees.threshold)):
        first = end
        for k in range(trees.term_start[m], trees.term_start[m + 1]):
            f, w = trees.feature[k], trees.weight[k]
            if end == first + 1 and feature[first] == f:
                total = np.float64(weight[first]) + np.float64(w)
                if np.isfinite(np.float32(total)) and np.float64(np.float32(total)) == total:
                    end, w = first, np.float32(total)
            if w != 0.0:
                feature[end], weight[end] = f, w
                end += 1
        if end == first:
            feature[end], weight[end] = trees.feature[trees.term_start[m]], 0.0
            end += 1
        term_start[m + 1] = end
    return term_start, feature[:end].copy(), weight[:end].copy()


@compiled
def _leaf_terms_that_matter(trees: ForestArrays) -> tuple[NDArray[np.int64], IntArray, FloatArray]:
    """Return where the terms of each leaf begin, their features and their weights, without those that add 0."""
    leaf_term_start = np.zeros_like(trees.leaf_term_start)
    leaf_feature, leaf_weight = np.empty_like(trees.leaf_feature), np.empty_like(trees.leaf_weight)
    end = 0
    for leaf in range(len(trees.leaf_term_start) - 1):
        for q in range(trees.leaf_term_start[leaf], trees.leaf_term_start[leaf + 1]):
            if np.any(trees.leaf_weight[q] != 0.0):
                leaf_feature[end], leaf_weight[end] = trees.leaf_feature[q], trees.leaf_weight[q]
                end += 1
        leaf_term_start[leaf + 1] = end
    return leaf_term_start, leaf_feature[:end].copy(), leaf_weight[:end].copy()


@compiled
def _least_on_the_far_side(w: float, threshold: np.float32) -> np.float32:
    """Return the least float32 on the upper side of `w * x = threshold`, not finite where there is none.

    A product of two float32 is exact in float64. The side goes right where `w > 0`, else left.
    """
    t = np.float64(threshold)
    below, above = np.float32(-np.inf), np.float32(np.inf)
    # Rounded, the quotient is one of the neighbours, or nearly so.
    least = np.float32(t / w)
    while np.isfinite(least) and ((w * np.float64(least) >= t) == (w > 0)):
        least = np.nextafter(least, below)
    while np.isfinite(least) and ((w * np.float64(least) >= t) != (w > 0)):
        least = np.nextafter(least, above)
    # Adding zero makes -0.0 into 0.0, as in a tree.
    return np.float32(least + np.float32(0.0))
