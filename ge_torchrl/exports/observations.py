"""Observations on which an export has to answer as its tree: a quarter of them where a rounding would show."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.seeding import stream
from ge_torchrl.trees.tree import DecisionTree, FloatArray

N_OBSERVATIONS = 10_000

_LARGEST = float(np.finfo(np.float32).max)
_SPECIAL = np.array([0.0, -0.0, 1.0, -1.0, 1e-45, -1e-45, _LARGEST, -_LARGEST], np.float32)


def observations_of(tree: DecisionTree, n_features: int, n: int = N_OBSERVATIONS) -> FloatArray:
    """Return finite observations that tell a tree from one that is nearly the same.

    The first quarter visits every split in turn. There, one feature is the float32 at which the split's answer
    changes, or one of both beside it. The others lie around the thresholds.

    Args:
        tree: The tree.
        n_features: Entries of an observation, D.
        n: How many observations.

    Returns:
        [n, D] float32, the same for the same tree.
    """
    rng = stream(0, "observations that verify an export")
    middle, spread = _ranges(tree, n_features)
    observed = middle + spread * rng.normal(size=(n, n_features)) * 10.0 ** rng.uniform(-2, 0.7, (n, 1))
    is_special = rng.random((n, n_features)) < 0.01
    observed = np.where(is_special, rng.choice(_SPECIAL, (n, n_features)), observed)
    finite = _finite(observed)
    if tree.num_decision_nodes:
        _approach(tree, finite[: n // 4], spread, rng)
    return finite


def _ranges(tree: DecisionTree, n_features: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return [D] where the thresholds of each feature lie, and [D] how far around it."""
    n_terms = np.diff(tree.term_start)
    split = np.repeat(np.arange(tree.num_decision_nodes), n_terms)
    with np.errstate(divide="ignore", invalid="ignore"):
        cuts = tree.threshold[split].astype(np.float64) / (tree.weight * n_terms[split])
    middle, spread = np.zeros(n_features), np.ones(n_features)
    for feature in np.unique(tree.feature):
        of_feature = cuts[(tree.feature == feature) & np.isfinite(cuts)]
        if len(of_feature):
            middle[feature] = np.median(of_feature)
            distance = np.abs(of_feature - middle[feature]).max()
            spread[feature] = distance or abs(middle[feature]) or 1.0
    return middle, spread


def _approach(
    tree: DecisionTree, observed: FloatArray, spread: NDArray[np.float64], rng: np.random.Generator
) -> None:
    """Move each row to a split, and there onto its threshold or beside it."""
    weights = _weights(tree, observed.shape[1])
    target = np.arange(len(observed)) % tree.num_decision_nodes
    ancestors, is_left = _paths(tree)
    rows = np.arange(len(observed))
    # What one split of the path needs may undo what another got; the second time little is left to do.
    for place in [*range(ancestors.shape[1])] * 2:
        split, goes_left = ancestors[target, place], is_left[target, place]
        is_below = _missing(tree, weights, observed, split) > 0
        wrong = np.flatnonzero((split >= 0) & (is_below != goes_left))
        feature = _one_feature(weights[split[wrong]], rng)
        scale = spread[feature] * 10.0 ** rng.uniform(-3, 0, len(wrong))
        beyond = np.abs(rng.normal(size=len(wrong))) * scale
        rises = weights[split[wrong], feature] > 0
        _move(tree, weights, observed, wrong, split[wrong], feature)
        moved = observed[wrong, feature].astype(np.float64) + np.where(
            rises == goes_left[wrong], -beyond, beyond
        )
        observed[wrong, feature] = _finite(moved)
    feature = _one_feature(weights[target], rng)
    for _ in range(2):
        _move(tree, weights, observed, rows, target, feature)
    at = observed[rows, feature]
    beside = np.stack([at, np.nextafter(at, -_LARGEST), np.nextafter(at, _LARGEST)])
    # Whole rounds over the splits, so that each of them gets all three.
    observed[rows, feature] = beside[rows // tree.num_decision_nodes % 3, rows]


def _paths(tree: DecisionTree) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return [M, depth] the splits above each split, from the root on and then -1, and whether the way goes left."""
    ancestors = np.full((tree.num_decision_nodes, tree.depth), -1)
    is_left = np.zeros(ancestors.shape, bool)
    depth = np.zeros(tree.num_decision_nodes, np.int64)
    # Parents are numbered before their children.
    for split in range(tree.num_decision_nodes):
        for children, goes_left in ((tree.children_left, True), (tree.children_right, False)):
            child, place = children[split], depth[split]
            if child >= 0:
                ancestors[child], is_left[child] = ancestors[split], is_left[split]
                ancestors[child, place], is_left[child, place] = split, goes_left
                depth[child] = place + 1
    return ancestors, is_left


def _weights(tree: DecisionTree, n_features: int) -> NDArray[np.float64]:
    """Return [M, D] the weight of each feature in each split."""
    weights = np.zeros((tree.num_decision_nodes, n_features))
    split = np.repeat(np.arange(tree.num_decision_nodes), np.diff(tree.term_start))
    np.add.at(weights, (split, tree.feature), tree.weight.astype(np.float64))
    return weights


def _one_feature(weights: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.int64]:
    """Return [B] a feature for each row of weights that is not 0 there, if there is any."""
    chosen: NDArray[np.int64] = np.argmax(rng.random(weights.shape) * (weights != 0), axis=1)
    return chosen


def _missing(
    tree: DecisionTree, weights: NDArray[np.float64], observed: FloatArray, split: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return [B] how much the sum of a split lacks of its threshold."""
    missing: NDArray[np.float64] = tree.threshold[split] - (weights[split] * observed).sum(axis=1)
    return missing


def _move(
    tree: DecisionTree,
    weights: NDArray[np.float64],
    observed: FloatArray,
    rows: NDArray[np.int64],
    split: NDArray[np.int64],
    feature: NDArray[np.int64],
) -> None:
    """Change one feature of each row so that the sum of a split is its threshold, as nearly as float32 can say it."""
    weight = weights[split, feature]
    step = _missing(tree, weights, observed[rows], split) / np.where(weight == 0, np.inf, weight)
    observed[rows, feature] = _finite(observed[rows, feature] + step)


def _finite(numbers: NDArray[np.float64]) -> FloatArray:
    return np.clip(numbers, -_LARGEST, _LARGEST).astype(np.float32)
