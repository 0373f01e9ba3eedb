"""Differentiable decision trees (DDT): trees whose thresholds and leaves a gradient can reach, and the way back.

Source: the thesis "Backpropagation-based reinforcement learning for decision trees", section 2.3, Eqs. 2 and 3; after
Silva et al., "Optimization methods for interpretable differentiable decision trees in reinforcement learning"
(AISTATS 2020).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from ge_torchrl.environments.backend import SoftForest
from ge_torchrl.refiners.rl.splits import SoftSplits, columns_of, padded
from ge_torchrl.trees.tree import DecisionTree

# The gradient of a logarithm is finite from here on, whatever float32 factors follow.
_LEAST_PROBABILITY = 1e-30


class DDT(SoftSplits):
    """`R` decision trees with soft decisions: action probabilities are the leaves', weighted by their paths.

    Args:
        trees: [R] trees with actions; their structures and features stay as they are.
        leaf_logits: [R, L, A], parameters whose softmax is a leaf's action probabilities; padding is not read.
        alpha: As in `SoftSplits`.
        straight_through: As in `SoftSplits`.

    Attributes:
        leaf_logits: [R, L, A] float32 parameter.
    """

    def __init__(
        self,
        trees: Sequence[DecisionTree],
        leaf_logits: Tensor,
        alpha: float = 1000.0,
        *,
        straight_through: bool = False,
    ) -> None:
        _check(trees, leaf_logits.shape[2])
        super().__init__(trees, alpha, straight_through=straight_through)
        self.leaf_logits = nn.Parameter(leaf_logits)

    def forward(self, observation: Tensor) -> Tensor:
        """Return the log-probabilities of the actions, `log sum_l w_l softmax(leaf_logits_l)`.

        Args:
            observation: [*S, D]; its rows are `R` equal runs, one a tree, such as [R, T, D] or [R * K, D].

        Returns:
            [*S, A], finite for every observation without NaN; none is below log(1e-30).
        """
        columns = columns_of(observation, self.num_trees, self.threshold.dtype)
        weights = self.weights(columns)
        # The softmax of a padded leaf is put to 0: it takes neither mass nor gradient.
        of_leaf = self.leaf_logits.softmax(-1) * self.is_leaf
        logits = torch.bmm(of_leaf.mT, weights).clamp_min(_LEAST_PROBABILITY).log()
        return logits.mT.reshape(*observation.shape[:-1], -1)

    @torch.no_grad()
    def hard_parts(self) -> dict[str, Tensor]:
        """Return the numbers of the hard trees, and the actions that their leaves prefer; see `SoftSplits`."""
        return {**super().hard_parts(), "action": self.leaf_logits.argmax(-1).int()}

    @torch.no_grad()
    def soft_forest(self) -> SoftForest:
        """Return the trees as they stand, for the compiled sampler."""
        return soft_forest_of(self, probabilities=self.leaf_logits.double().softmax(-1).numpy())


@torch.no_grad()
def soft_forest_of(splits: SoftSplits, **leaves: NDArray[np.float64]) -> SoftForest:
    """Return trees as they stand, with these arrays for the leaves of one kind; see `SoftForest`."""
    alpha = splits.alpha / splits.scale.double()
    nothing = {
        "probabilities": np.zeros((0, 0, 0)),
        "mean": np.zeros((0, 0, 0)),
        "leaf_weight": np.zeros((0, 0, 0, 0)),
        "sd": np.zeros((0, 0, 0)),
    }
    return SoftForest(
        feature=splits.feature.int().numpy(),
        weight=splits.split_weights().double().numpy(),
        threshold=splits.thresholds().float().numpy(),
        alpha=(torch.full_like(alpha, torch.inf) if splits.straight_through else alpha).numpy(),
        children_left=padded([tree.children_left for tree in splits.trees], ~0),
        children_right=padded([tree.children_right for tree in splits.trees], ~0),
        **{**nothing, **leaves},
    )


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
        straight_through: As in `SoftSplits`.

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


def _check(trees: Sequence[DecisionTree], n_actions: int) -> None:
    for tree in trees:
        if not tree.has_actions:
            raise ValueError(
                "these soft trees are made of leaves with actions; those with values are Gaussian"
            )
        if tree.action.max() >= n_actions:
            raise ValueError(
                f"the tree chooses action {tree.action.max()}, but there are only {n_actions} actions"
            )
