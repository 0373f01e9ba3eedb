"""Differentiable decision trees (DDT): a tree whose thresholds and leaves a gradient can reach, and the way back.

Source: the thesis "Backpropagation-based reinforcement learning for decision trees", section 2.3, Eqs. 2 and 3; after
Silva et al., "Optimization methods for interpretable differentiable decision trees in reinforcement learning"
(AISTATS 2020).
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from ge_torchrl.environments.soft_rollouts import SoftTree
from ge_torchrl.trees.decision_tree import DecisionTree, FloatArray

# sigma(-1e4) is 0 in any precision, so nothing is lost where the argument of a sigmoid ends here; without an end,
# a far threshold would give -inf, and 0 * -inf on the paths that do not pass it.
_LARGEST_LOGIT = 1e4
# The gradient of a logarithm is finite from here on, whatever float32 factors follow.
_LEAST_PROBABILITY = 1e-30


class DDT(nn.Module):
    """A decision tree with soft decisions: action probabilities are the leaves', weighted by their paths.

    With `phi` the threshold and `x` the observed feature, a decision gives its TRUE (left) branch the weight
    `sigma(alpha (phi - x))` and its FALSE (right) branch `sigma(alpha (x - phi))`; a path weighs the product of its
    branches. Eq. 2 of the thesis prints `sigma(alpha (x - phi))`, the weight of the FALSE branch. At `x = phi`, where
    the hard tree goes right, each branch weighs exactly one half.

    Features may be standardised: `phi` and `x` are then counted from `origin` in units of `scale`, so that one `alpha`
    and one learning rate suit features of any size. The hard tree is always in the feature's own units.

    Args:
        tree: The structure; it and the features stay as they are.
        leaf_logits: [L, A], parameters whose softmax is a leaf's action probabilities; leaves in node order.
        alpha: Steepness of every decision; an attribute that may be changed at any time.

    Attributes:
        tree: The tree that this one was made from.
        threshold: [M] float32 parameter, thresholds of the decision nodes in node order, from `origin` in units of
            `scale`.
        leaf_logits: [L, A] float32 parameter.
        feature: [M] int64 buffer.
        origin: [M] float32 buffer, 0 unless standardised.
        scale: [M] float32 buffer, 1 unless standardised.
        is_left: [M, L] buffer, 1 where the path to the leaf takes the decision's left branch, else 0.
        is_right: [M, L] buffer, likewise for the right branch.
    """

    feature: Tensor
    origin: Tensor
    scale: Tensor
    is_left: Tensor
    is_right: Tensor

    def __init__(self, tree: DecisionTree, leaf_logits: Tensor, alpha: float = 1000.0) -> None:
        super().__init__()
        self.tree = tree
        self.alpha = alpha
        decisions = ~tree.is_leaf
        is_left, is_right = _paths(tree)
        self.register_buffer("feature", torch.tensor(tree.feature[decisions], dtype=torch.int64))
        self.register_buffer("is_left", torch.tensor(is_left))
        self.register_buffer("is_right", torch.tensor(is_right))
        self.threshold = nn.Parameter(torch.tensor(tree.threshold[decisions]))
        self.register_buffer("origin", torch.zeros_like(self.threshold))
        self.register_buffer("scale", torch.ones_like(self.threshold))
        self.leaf_logits = nn.Parameter(leaf_logits)

    @property
    def n_actions(self) -> int:
        """Number of actions, A."""
        return self.leaf_logits.shape[1]

    def forward(self, observation: Tensor) -> Tensor:
        """Return the log-probabilities of the actions, `log sum_l w_l softmax(leaf_logits_l)`.

        Args:
            observation: [..., D].

        Returns:
            [..., A], finite for every observation without NaN; none is below log(1e-30).
        """
        observed = observation.index_select(-1, self.feature).to(self.threshold.dtype)
        logit = self.alpha * (self.threshold - (observed - self.origin) / self.scale)
        logit = logit.clamp(-_LARGEST_LOGIT, _LARGEST_LOGIT)
        log_weights = (
            functional.logsigmoid(logit) @ self.is_left + functional.logsigmoid(-logit) @ self.is_right
        )
        probabilities = log_weights.exp() @ self.leaf_logits.softmax(-1)
        return probabilities.clamp_min(_LEAST_PROBABILITY).log()

    @torch.no_grad()
    def standardise(self, spread: Tensor) -> None:
        """Count thresholds from where they are now, in units of their features' spread; the hard tree stays the same.

        Args:
            spread: [D], how far the values of each feature lie apart, above 0.
        """
        # The origin is the threshold itself, so that what has not moved comes back to the last bit.
        self.origin.copy_(self.thresholds())
        self.scale.copy_(spread[self.feature])
        self.threshold.zero_()

    @torch.no_grad()
    def thresholds(self) -> Tensor:
        """Return the thresholds [M] in their features' own units."""
        return self.origin + self.scale * self.threshold

    @torch.no_grad()
    def arrays(self) -> SoftTree:
        """Return the tree as it stands, for the compiled sampler."""
        tree = harden(self)
        probabilities = np.zeros((tree.n_nodes, self.n_actions))
        probabilities[tree.is_leaf] = self.leaf_logits.double().softmax(-1).numpy()
        alpha = np.ones(tree.n_nodes)
        alpha[~tree.is_leaf] = self.alpha / self.scale.double().numpy()
        return SoftTree(
            tree.feature,
            tree.threshold,
            tree.children_left,
            tree.children_right,
            probabilities,
            alpha,
        )


def soften(
    tree: DecisionTree,
    n_actions: int,
    alpha: float = 1000.0,
    leaf_sd: float = 0.1,
    leaf_scale: float = 1.0,
    generator: torch.Generator | None = None,
) -> DDT:
    """Return the DDT that starts from a tree.

    A leaf's logits are drawn around Eq. 3 of the thesis: `Normal(mean, leaf_sd)` with mean
    `leaf_scale * (n_actions - 1)` at the leaf's action and 0 elsewhere. The softmax is the DDT's.

    Args:
        tree: The tree.
        n_actions: Number of actions, A.
        alpha: Steepness of every decision.
        leaf_sd: Standard deviation of the logits.
        leaf_scale: 1 is Eq. 3; the larger, the nearer a leaf is to always choosing its action.
        generator: The source of randomness; needed unless `leaf_sd` is 0.

    Raises:
        ValueError: Leaves are to be drawn and there is no generator, or the tree has actions beyond `n_actions`.
    """
    if leaf_sd > 0 and generator is None:
        raise ValueError(
            "soften needs a generator to draw the leaves from, or leaf_sd=0; got leaf_sd > 0 and none"
        )
    if tree.action.max() >= n_actions:
        raise ValueError(
            f"the tree chooses action {tree.action.max()}, but there are only {n_actions} actions"
        )
    action = torch.tensor(tree.action[tree.is_leaf], dtype=torch.int64)
    mean = leaf_scale * (n_actions - 1) * functional.one_hot(action, n_actions).float()
    noise = leaf_sd * torch.randn(mean.shape, generator=generator) if leaf_sd > 0 else 0.0
    return DDT(tree, mean + noise, alpha)


@torch.no_grad()
def harden(ddt: DDT) -> DecisionTree:
    """Return the hard tree of a DDT: its structure, thresholds in float32, each leaf's most probable action.

    Raises:
        InvalidTreeError: A threshold is not a finite number.
    """
    tree = ddt.tree
    threshold, action = tree.threshold.copy(), tree.action.copy()
    threshold[~tree.is_leaf] = ddt.thresholds().float().numpy()
    action[tree.is_leaf] = ddt.leaf_logits.argmax(-1).numpy()
    return DecisionTree(tree.feature, threshold, tree.children_left, tree.children_right, action)


def _paths(tree: DecisionTree) -> tuple[FloatArray, FloatArray]:
    """Return two [M, L] float32 matrices: which decisions the path to each leaf leaves by the left, by the right."""
    decisions, leaves = _ranks(~tree.is_leaf), _ranks(tree.is_leaf)
    shape = (tree.n_decision_nodes, tree.n_decision_nodes + 1)
    is_left, is_right = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    # A node with the decisions above it: those left by the left, those left by the right.
    open_nodes: list[tuple[int, list[int], list[int]]] = [(0, [], [])]
    while open_nodes:
        node, lefts, rights = open_nodes.pop()
        if tree.is_leaf[node]:
            is_left[lefts, leaves[node]] = 1
            is_right[rights, leaves[node]] = 1
        else:
            decision = int(decisions[node])
            open_nodes.append((int(tree.children_left[node]), [*lefts, decision], rights))
            open_nodes.append((int(tree.children_right[node]), lefts, [*rights, decision]))
    return is_left, is_right


def _ranks(chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return [N], how many nodes before each one are chosen."""
    ranks: NDArray[np.int64] = np.cumsum(chosen) - chosen
    return ranks
