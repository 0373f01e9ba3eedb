"""Soft trees in plain float64: what the compiled sampler and the torch module are held to."""

import math

import numpy as np

from ge_torchrl.environments.soft_rollouts import SoftTree


def sigmoid(z):
    return 1 / (1 + math.exp(-z)) if z >= 0 else 1 - 1 / (1 + math.exp(z)) if z > -700 else 0.0


def left_weight(tree, alpha, node, observation):
    alpha = np.broadcast_to(alpha, len(tree.feature))[node]
    return sigmoid(alpha * (float(tree.threshold[node]) - float(observation[tree.feature[node]])))


def mixture(tree, probabilities, alpha, observation, node=0):
    """Return [A]; `probabilities` [N, A] are the leaves'."""
    if tree.children_left[node] < 0:
        return probabilities[node]
    weight = left_weight(tree, alpha, node, observation)
    left = mixture(tree, probabilities, alpha, observation, tree.children_left[node])
    right = mixture(tree, probabilities, alpha, observation, tree.children_right[node])
    return weight * left + (1 - weight) * right


def hard_path_weight(tree, alpha, observation):
    """Return the weight of the path that the hard tree takes."""
    node, weight = 0, 1.0
    while tree.children_left[node] >= 0:
        left = left_weight(tree, alpha, node, observation)
        goes_left = observation[tree.feature[node]] < tree.threshold[node]
        weight *= left if goes_left else 1 - left
        node = tree.children_left[node] if goes_left else tree.children_right[node]
    return weight


def soft_tree(tree, n_actions, alpha, sharpness=1.0):
    """Return a SoftTree whose leaves prefer their action by `sharpness` nats."""
    logits = sharpness * np.eye(n_actions)[np.maximum(tree.action, 0)]
    probabilities = np.exp(logits) / np.exp(logits).sum(1, keepdims=True)
    return SoftTree(
        tree.feature,
        tree.threshold,
        tree.children_left,
        tree.children_right,
        probabilities,
        np.full(tree.n_nodes, alpha),
    )


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
