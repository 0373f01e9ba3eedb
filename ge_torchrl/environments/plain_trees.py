"""A tree as plain Python: for one observation at a time nothing is quicker that needs no compiler."""

from __future__ import annotations

import itertools
from typing import Any

from ge_torchrl.trees.forest import ForestArrays


def nested(arrays: ForestArrays, tree: int) -> tuple[Any, bool]:
    """Return a tree as nested tuples, and whether each of its splits compares one feature.

    A split is (feature, threshold, left, right), a leaf its number; where splits are sums, the feature is
    ((feature, weight), ...).
    """
    first, end = int(arrays.split_start[tree]), int(arrays.split_start[tree + 1])
    splits, terms = slice(first, end), slice(int(arrays.term_start[first]), int(arrays.term_start[end]))
    is_axis_aligned = terms.stop - terms.start == end - first and bool((arrays.weight[terms] == 1).all())
    features: list[Any] = arrays.feature[terms].tolist()
    if not is_axis_aligned:
        weighted = list(zip(features, arrays.weight[terms].tolist(), strict=True))
        starts = (arrays.term_start[first : end + 1] - terms.start).tolist()
        features = [tuple(weighted[a:b]) for a, b in itertools.pairwise(starts)]
    thresholds = arrays.threshold[splits].tolist()
    left, right = arrays.children_left[splits].tolist(), arrays.children_right[splits].tolist()
    nodes: list[Any] = [0] * (end - first)
    # Depth first, children stand behind their parents.
    for m in range(end - first - 1, -1, -1):
        children = [nodes[child] if child >= 0 else ~child for child in (left[m], right[m])]
        nodes[m] = (features[m], thresholds[m], *children)
    return nodes[0] if nodes else 0, is_axis_aligned


def leaves(arrays: ForestArrays, tree: int) -> tuple[list[Any], list[Any] | None]:
    """Return what each leaf of a tree answers; where one adds linear terms, its law besides.

    A law has for each value (constant, ((feature, weight), ...)).
    """
    first, end = int(arrays.leaf_start[tree]), int(arrays.leaf_start[tree + 1])
    if len(arrays.action) > 0:
        return arrays.action[first:end].tolist(), None
    constants = arrays.value[first:end].tolist()
    starts = arrays.leaf_term_start[first : end + 1].tolist()
    if starts[0] == starts[-1]:
        return constants, None
    laws = []
    for values, (a, b) in zip(constants, itertools.pairwise(starts), strict=True):
        features, weights = arrays.leaf_feature[a:b].tolist(), arrays.leaf_weight[a:b].T.tolist()
        laws.append(
            [
                (value, tuple(zip(features, own, strict=True)))
                for value, own in zip(values, weights, strict=True)
            ]
        )
    return constants, laws


def values_of(law: Any, observation: list[float]) -> list[float]:
    """Return the values of a leaf's law, summed in float64 in the order of its terms."""
    values = []
    for total, terms in law:
        for feature, weight in terms:
            total += weight * observation[feature]  # noqa: PLW2901
        values.append(total)
    return values


def walk_sums(node: Any, observation: list[float]) -> int:
    """Return the leaf that a tree of sums sends an observation to."""
    while type(node) is tuple:
        terms, threshold, left, right = node
        total = 0.0
        for feature, weight in terms:
            total += weight * observation[feature]
        node = left if total < threshold else right
    leaf: int = node
    return leaf
