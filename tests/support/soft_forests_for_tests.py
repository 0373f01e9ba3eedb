"""Soft trees in plain float64: what the compiled sampler is held to."""

import numpy as np

from ge_torchrl.environments.backend import SoftForest


def soft_forest(trees, n_actions, alpha, sharpness=1.0):
    """The trees side by side, padded; a leaf prefers its action by `sharpness` nats."""
    n_splits = max(tree.num_decision_nodes for tree in trees)

    def padded(arrays, fill, dtype, width=n_splits):
        rows = np.full((len(arrays), width), fill, dtype)
        for row, array in zip(rows, arrays, strict=True):
            row[: len(array)] = array
        return rows

    actions = padded([tree.action for tree in trees], 0, np.int64, n_splits + 1)
    weights = np.exp(sharpness * np.eye(n_actions)[actions])
    return SoftForest.with_actions(
        padded([tree.feature for tree in trees], 0, np.int32),
        padded([tree.threshold for tree in trees], 0, np.float32),
        np.full((len(trees), n_splits), float(alpha)),
        padded([tree.children_left for tree in trees], ~0, np.int32),
        padded([tree.children_right for tree in trees], ~0, np.int32),
        weights / weights.sum(2, keepdims=True),
    )


def hard_forest(trees, n_actions):
    """The trees side by side, infinitely steep, each leaf certain of its action."""
    soft = soft_forest(trees, n_actions, np.inf, sharpness=1.0)
    return soft._replace(probabilities=(soft.probabilities >= soft.probabilities.max(2, keepdims=True)) + 0.0)


def mixtures(soft, tree, observations, node=None):
    """Return [T, A], the probability of each action on each observation [T, D]."""
    if node is None:
        node = 0 if soft.feature.shape[1] > 0 else ~0
    if node < 0:
        return np.tile(soft.probabilities[tree, ~node], (len(observations), 1))
    terms = soft.weight[tree, node] * observations[:, soft.feature[tree, node]].astype(float)
    distance = np.float64(soft.threshold[tree, node]) - terms.sum(1)
    weight = 1 / (1 + np.exp(-np.clip(soft.alpha[tree, node] * distance, -700, 700)))[:, None]
    left = mixtures(soft, tree, observations, soft.children_left[tree, node])
    right = mixtures(soft, tree, observations, soft.children_right[tree, node])
    return weight * left + (1 - weight) * right


def calibration(observations, actions, probabilities):
    """Return the largest |z| of the actions against their probabilities [T, A], overall and along each feature.

    Given its observation an action is drawn independently of the past, so each weighted sum of `1[a] - p` over the
    steps is, divided by its standard deviation, close to a standard normal.
    """
    spread = np.maximum(observations.std(0), 1e-9)
    weights = np.column_stack([np.ones(len(actions)), (observations - observations.mean(0)) / spread])
    residuals = np.eye(probabilities.shape[1])[actions] - probabilities
    variances = (weights**2).T @ (probabilities * (1 - probabilities))
    return np.abs(weights.T @ residuals / np.sqrt(np.maximum(variances, 1e-9))).max()
