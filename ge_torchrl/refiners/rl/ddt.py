"""Differentiable decision trees (DDT): trees whose thresholds and leaves a gradient can reach, and the way back.

Source: the thesis "Backpropagation-based reinforcement learning for decision trees", section 2.3, Eqs. 2 and 3; after
Silva et al., "Optimization methods for interpretable differentiable decision trees in reinforcement learning"
(AISTATS 2020).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from ge_torchrl.environments.backend import SoftForest
from ge_torchrl.trees.tree import DecisionTree

_Number = TypeVar("_Number", bound=np.generic)

# sigma(-1e30) is 0 in any precision, so nothing is lost where the argument of a sigmoid ends; without an end, a far
# threshold would give -inf, and 0 * -inf on the paths that do not pass it.
_LARGEST_LOGIT = 1e30
# The gradient of a logarithm is finite from here on, whatever float32 factors follow.
_LEAST_PROBABILITY = 1e-30


class DDT(nn.Module):
    """`R` decision trees with soft decisions: action probabilities are the leaves', weighted by their paths.

    With `phi` the threshold and `x` the observed feature, a split gives its TRUE (left) branch the weight
    `sigma(alpha (phi - x))` and its FALSE (right) branch `sigma(alpha (x - phi))`; a path weighs the product of its
    branches. Eq. 2 of the thesis prints `sigma(alpha (x - phi))`, the weight of the FALSE branch. At `x = phi`, where
    the hard tree goes right, each branch weighs exactly one half.

    `phi` and `x` are counted from `origin` in units of `scale`, so that one `alpha` and one learning rate suit
    features of any size. The hard tree is always in the feature's own units.

    Trees are padded to the `M` splits (at least one) and `L = M + 1` leaves of the largest. Padding has no mass and no
    gradient.

    Args:
        trees: [R] axis-aligned trees with actions; their structures and features stay as they are.
        leaf_logits: [R, L, A], parameters whose softmax is a leaf's action probabilities; padding is not read.
        alpha: Steepness of every split; an attribute that may be changed at any time.
        straight_through: Whether the hard path decides, and the soft paths give its gradient.

    Attributes:
        trees: The trees that these were made from.
        threshold: [R, M] float32 parameter, counted from `origin` in units of `scale`.
        leaf_logits: [R, L, A] float32 parameter.
        feature: [R, M] int64 buffer.
        origin: [R, M] float32 buffer, the thresholds of `trees`.
        scale: [R, M] float32 buffer, 1 unless standardised.
        is_left: [R, L, M] buffer, 1 where the path to the leaf takes the split's left branch, else 0.
        is_right: [R, L, M] buffer, likewise for the right branch.
        is_leaf: [R, L, 1] buffer, 1 for a leaf and 0 for padding.
    """

    feature: Tensor
    origin: Tensor
    scale: Tensor
    is_left: Tensor
    is_right: Tensor
    is_leaf: Tensor

    def __init__(
        self,
        trees: Sequence[DecisionTree],
        leaf_logits: Tensor,
        alpha: float = 1000.0,
        *,
        straight_through: bool = False,
    ) -> None:
        super().__init__()
        _check(trees, leaf_logits.shape[2])
        self.trees = tuple(trees)
        self.alpha = alpha
        self.straight_through = straight_through
        is_left, is_right, is_leaf = _paths(trees)
        self.register_buffer("feature", torch.from_numpy(_padded([t.feature for t in trees])).long())
        self.register_buffer("is_left", torch.from_numpy(is_left))
        self.register_buffer("is_right", torch.from_numpy(is_right))
        self.register_buffer("is_leaf", torch.from_numpy(is_leaf))
        # Moves are what is trained, so that what has not moved comes back to the last bit.
        self.register_buffer("origin", torch.from_numpy(_padded([t.threshold for t in trees])))
        self.threshold = nn.Parameter(torch.zeros_like(self.origin))
        self.register_buffer("scale", torch.ones_like(self.threshold))
        self.leaf_logits = nn.Parameter(leaf_logits)

    @property
    def num_trees(self) -> int:
        """Number of trees, R."""
        return len(self.trees)

    def forward(self, observation: Tensor) -> Tensor:
        """Return the log-probabilities of the actions, `log sum_l w_l softmax(leaf_logits_l)`.

        Args:
            observation: [*S, D]; its rows are `R` equal runs, one a tree, such as [R, T, D] or [R * K, D].

        Returns:
            [*S, A], finite for every observation without NaN; none is below log(1e-30).
        """
        columns = columns_of(observation, self.num_trees, self.threshold.dtype)
        row = self.feature + columns.shape[1] * torch.arange(self.num_trees).unsqueeze(-1)
        observed = columns.flatten(0, 1).index_select(0, row.flatten()).view(*row.shape, -1)
        weights = self._leaf_weights(observed)
        # The softmax of a padded leaf is put to 0: it takes neither mass nor gradient.
        of_leaf = self.leaf_logits.softmax(-1) * self.is_leaf
        logits = torch.bmm(of_leaf.mT, weights).clamp_min(_LEAST_PROBABILITY).log()
        return logits.mT.reshape(*observation.shape[:-1], -1)

    def _leaf_weights(self, observed: Tensor) -> Tensor:
        """Return the weights [R, L, T] of the leaves from the features [R, M, T] that the splits ask for."""
        steepness = (self.alpha / self.scale).unsqueeze(-1)
        beyond = (
            (observed - self.origin.unsqueeze(-1)).mul_(steepness).clamp_(-_LARGEST_LOGIT, _LARGEST_LOGIT)
        )
        logit = self.alpha * self.threshold.unsqueeze(-1) - beyond
        log_left = functional.logsigmoid(logit)
        weights = torch.baddbmm(torch.bmm(self.is_left, log_left), self.is_right, log_left - logit).exp()
        if self.straight_through:
            # The value is the hard path's, the gradient that of the soft paths.
            weights = weights + (self._hard_weights(observed) - weights).detach()
        return weights

    @torch.no_grad()
    def _hard_weights(self, observed: Tensor) -> Tensor:
        """Return 1 for the leaf that the hard tree reaches and 0 for the others, [R, L, T]."""
        goes_left = (observed < self.thresholds().unsqueeze(-1)).to(observed.dtype)
        wrong_turns = torch.bmm(self.is_left, 1 - goes_left) + torch.bmm(self.is_right, goes_left)
        return (wrong_turns == 0).to(observed.dtype)

    @torch.no_grad()
    def standardise(self, spread: Tensor) -> None:
        """Count the moves of thresholds in units of their features' spread; the hard trees stay the same.

        Args:
            spread: [R, D], how far the values of each feature lie apart, above 0.
        """
        moved = self.scale * self.threshold
        self.scale.copy_(spread.gather(1, self.feature))
        self.threshold.copy_(moved / self.scale)

    @torch.no_grad()
    def thresholds(self) -> Tensor:
        """Return the thresholds [R, M] in their features' own units."""
        return self.origin + self.scale * self.threshold

    @torch.no_grad()
    def soft_forest(self) -> SoftForest:
        """Return the trees as they stand, for the compiled sampler."""
        alpha = self.alpha / self.scale.double()
        return SoftForest.with_actions(
            feature=self.feature.int().numpy(),
            threshold=self.thresholds().float().numpy(),
            alpha=(torch.full_like(alpha, torch.inf) if self.straight_through else alpha).numpy(),
            children_left=_padded([tree.children_left for tree in self.trees], ~0),
            children_right=_padded([tree.children_right for tree in self.trees], ~0),
            probabilities=self.leaf_logits.double().softmax(-1).numpy(),
        )


def columns_of(observation: Tensor, num_trees: int, dtype: torch.dtype) -> Tensor:
    """Return observations [*S, D] of any number type as [R, D, T]: entries in columns are read as wholes."""
    rows = observation.to(dtype).reshape(num_trees, -1, observation.shape[-1])
    return rows.mT.contiguous()


def soften(
    trees: Sequence[DecisionTree],
    n_actions: int,
    alpha: float = 1000.0,
    leaf_sd: float = 0.1,
    leaf_logit: float | None = None,
    generators: Sequence[torch.Generator] | None = None,
    *,
    straight_through: bool = False,
) -> DDT:
    """Return the DDT that starts from trees.

    A leaf's logits are drawn around Eq. 3 of the thesis: `Normal(mean, leaf_sd)` with mean `leaf_logit` at the leaf's
    action and 0 elsewhere. The softmax is the DDT's.

    Args:
        trees: [R] trees.
        n_actions: Number of actions, A.
        alpha: Steepness of every split.
        leaf_sd: Standard deviation of the logits.
        leaf_logit: The larger, the nearer a leaf is to always choosing its action; None is Eq. 3, `A - 1`.
        generators: [R] the source of randomness of each tree; needed unless `leaf_sd` is 0.
        straight_through: As in `DDT`.

    Raises:
        ValueError: Leaves are to be drawn and there are no generators, or a tree is none that can be softened.
    """
    _check(trees, n_actions)
    if leaf_sd > 0 and generators is None:
        raise ValueError(
            "soften needs generators to draw the leaves from, or leaf_sd=0; got leaf_sd > 0 and none"
        )
    mean = float(n_actions - 1) if leaf_logit is None else leaf_logit
    n_leaves = max(2, *(tree.num_leaves for tree in trees))
    logits = torch.zeros(len(trees), n_leaves, n_actions)
    for row, tree in enumerate(trees):
        action = torch.from_numpy(tree.action.astype(np.int64))
        own = logits[row, : tree.num_leaves]
        own[torch.arange(len(own)), action] = mean
        if leaf_sd > 0 and generators is not None:
            own += leaf_sd * torch.randn(own.shape, generator=generators[row])
    return DDT(trees, logits, alpha, straight_through=straight_through)


@torch.no_grad()
def hard_numbers(ddt: DDT) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Return the thresholds [R, M] and the actions [R, L] of the hard trees, padded."""
    return ddt.thresholds().float().numpy(), ddt.leaf_logits.argmax(-1).int().numpy()


def _check(trees: Sequence[DecisionTree], n_actions: int) -> None:
    for tree in trees:
        if not tree.has_actions or not tree.is_axis_aligned:
            raise ValueError("a soft tree is made of splits by one feature each and of leaves with actions")
        if tree.action.max() >= n_actions:
            raise ValueError(
                f"the tree chooses action {tree.action.max()}, but there are only {n_actions} actions"
            )


def _padded(rows: Sequence[NDArray[_Number]], filling: int = 0) -> NDArray[_Number]:
    """Return [R, N], the rows filled up to the longest, and to one."""
    padded = np.full((len(rows), max(1, *map(len, rows))), filling, rows[0].dtype)
    for place, row in zip(padded, rows, strict=True):
        place[: len(row)] = row
    return padded


def _paths(
    trees: Sequence[DecisionTree],
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Return [R, L, M] which splits the path to each leaf leaves by the left and by the right, and [R, L, 1] leaves."""
    n_splits = max(1, *(tree.num_decision_nodes for tree in trees))
    shape = (len(trees), n_splits + 1, n_splits)
    is_left, is_right = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    is_leaf = np.zeros((*shape[:2], 1), np.float32)
    for row, tree in enumerate(trees):
        is_leaf[row, : tree.num_leaves] = 1
        # What leads to a split: the splits above it left by the left, and by the right. Parents come first.
        above: list[tuple[list[int], list[int]]] = [([], [])] * tree.num_decision_nodes
        for split in range(tree.num_decision_nodes):
            lefts, rights = above[split]
            for child, path in (
                (int(tree.children_left[split]), ([*lefts, split], rights)),
                (int(tree.children_right[split]), (lefts, [*rights, split])),
            ):
                if child >= 0:
                    above[child] = path
                else:
                    is_left[row, ~child, path[0]] = 1
                    is_right[row, ~child, path[1]] = 1
    return is_left, is_right, is_leaf
