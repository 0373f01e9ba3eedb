"""Soft trees whose leaves hold values: mixtures of normal distributions around what their leaves answer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from ge_torchrl.environments.backend import SoftForest
from ge_torchrl.refiners.rl.ddt import soft_forest_of
from ge_torchrl.refiners.rl.splits import LARGEST_FEATURE, LARGEST_WEIGHT, SoftSplits, columns_of, padded
from ge_torchrl.trees.tree import DecisionTree

FIRST_SD: Final = 0.3
"""Standard deviation of what leaves draw at first, in halves of the distance of an action's bounds."""

# Without an end, a deviation that falls makes every later step of its mean the largest that clipping lets pass.
_LEAST_SD = 1e-3


class GaussianDDT(SoftSplits):
    """`R` decision trees with soft decisions, whose leaves draw values around their own ones.

    A leaf is drawn with the weight of its path, and each value from a normal distribution around the leaf's constant
    and linear terms: a mixture, and not one distribution around the mean of leaves. So going down at random and
    drawing from the leaf draws from the trees' own distribution, and a tree that has to choose between left and right
    is not drawn to the middle.

    Moves of values are counted in `unit`, those of linear weights in units that move the value by about as much. A
    linear weight turns its leaf around the means of features, as in splits.

    Args:
        trees: [R] trees with A values; their structures and features stay as they are.
        n_features: Number of features, D.
        unit: [A], the natural size of a change of each value.
        sd: Standard deviation of what leaves draw, in `unit`.
        alpha: As in `SoftSplits`.
        straight_through: As in `SoftSplits`.

    Attributes:
        value: [R, L, A] float32 parameter, counted from `first_value` in `unit`.
        leaf_weight: [R, L, Q, A] float32 parameter, counted from `first_leaf_weight` in `unit` over the feature's
            spread; None where no leaf has linear terms.
        log_sd: [R, A] float32 parameter, logarithm of the deviations in `unit`.
        leaf_feature: [R, L, Q] int64 buffer, of each linear term.
        unit: [A] float32 buffer.
    """

    leaf_feature: Tensor
    first_value: Tensor
    first_leaf_weight: Tensor
    leaf_weight_unit: Tensor
    value_at_centre: Tensor
    unit: Tensor
    leaf_weight: nn.Parameter | None

    def __init__(
        self,
        trees: Sequence[DecisionTree],
        n_features: int,
        unit: Tensor,
        sd: float = FIRST_SD,
        alpha: float = 1000.0,
        *,
        straight_through: bool = False,
    ) -> None:
        _check(trees, len(unit))
        super().__init__(trees, alpha, straight_through=straight_through)
        self._n_features = n_features
        n_leaves = self.is_leaf.shape[1]
        self.register_buffer("unit", unit.float())
        self.register_buffer("first_value", torch.zeros(len(trees), n_leaves, len(unit)))
        for row, tree in enumerate(trees):
            self.first_value[row, : tree.num_leaves] = torch.from_numpy(tree.value.copy())
        self.value = nn.Parameter(torch.zeros_like(self.first_value))
        self.log_sd = nn.Parameter(torch.full((len(trees), len(unit)), math.log(sd)))
        terms = _linear_terms(trees, n_leaves)
        self.register_buffer("value_at_centre", self.first_value.clone())
        self.register_buffer("leaf_feature", torch.from_numpy(terms[0]).long())
        self.register_buffer("first_leaf_weight", torch.from_numpy(terms[1]))
        self.register_buffer("leaf_weight_unit", torch.from_numpy(terms[2])[..., None] * self.unit)
        if self.leaf_feature.shape[2] == 0:
            self.register_parameter("leaf_weight", None)
        else:
            self.leaf_weight = nn.Parameter(torch.zeros_like(self.first_leaf_weight))

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return the mixtures of observations.

        Args:
            observation: [*S, D]; its rows are `R` equal runs, one a tree, such as [R, T, D] or [R * K, D].

        Returns:
            The weights [*S, L] of the leaves, what they answer [*S, L, A], and the logarithm [*S, A] of the standard
            deviations around it; all are finite for every observation without NaN.
        """
        columns = columns_of(observation, self.num_trees, self.threshold.dtype)
        shape, n_rows = observation.shape[:-1], columns.shape[2]
        weights = (self.weights(columns) * self.is_leaf).mT
        answers = self._answers(columns).movedim(3, 1)
        log_sd = self.log_sd.clamp_min(math.log(_LEAST_SD)) + self.unit.log()
        log_sd = log_sd.unsqueeze(1).expand(-1, n_rows, -1)
        return (
            weights.reshape(*shape, -1),
            answers.reshape(*shape, *answers.shape[2:]),
            log_sd.reshape(*shape, -1),
        )

    @torch.no_grad()
    def standardise(self, spread: Tensor, mean: Tensor | None = None) -> None:
        """Count the moves of numbers in units of their features' spread; see `SoftSplits`."""
        turned = self._values()
        super().standardise(spread, mean)
        if self.leaf_weight is None:
            return
        moved = self.leaf_weight_unit * self.leaf_weight
        unit = (self.unit / self._of_leaf_terms(spread)).clamp(1e-30, LARGEST_WEIGHT)
        self.leaf_weight_unit.copy_(torch.where(self.leaf_weight_unit > 0, unit, 0.0))
        self.leaf_weight.copy_(torch.where(moved == 0, 0.0, moved / self.leaf_weight_unit))
        centre = self._of_leaf_terms(self.centre.squeeze(-1)).double()
        self.value_at_centre.copy_(self.first_value + (self.first_leaf_weight * centre).sum(2))
        self.value.copy_((turned - self.first_value + (moved * centre).sum(2)) / self.unit)

    @torch.no_grad()
    def hard_parts(self) -> dict[str, Tensor]:
        """Return the numbers of the hard trees, those of leaves included; see `SoftSplits`."""
        return {**super().hard_parts(), "value": self._values(), "leaf_weight": self._leaf_weights()}

    @torch.no_grad()
    def soft_forest(self) -> SoftForest:
        """Return the trees as they stand, for the compiled sampler."""
        sd = self.unit * self.log_sd.clamp_min(math.log(_LEAST_SD)).exp()
        return soft_forest_of(
            self,
            mean=self._values().double().numpy(),
            leaf_weight=self._dense(self._n_features).mT.double().contiguous().numpy(),
            sd=sd.double().unsqueeze(1).expand(-1, self.is_leaf.shape[1], -1).contiguous().numpy(),
        )

    def _answers(self, columns: Tensor) -> Tensor:
        """Return what leaves answer, [R, L, A, T]; [R, L, A, 1] would do where they answer constants."""
        start = (self.value_at_centre + self.unit * self.value).clamp(-LARGEST_FEATURE, LARGEST_FEATURE)
        if self.leaf_weight is None:
            return start.unsqueeze(-1).expand(*start.shape, columns.shape[2])
        slope = self._dense(columns.shape[1]).clamp(-LARGEST_WEIGHT, LARGEST_WEIGHT).flatten(1, 2)
        answers = torch.baddbmm(start.flatten(1).unsqueeze(-1), slope, self.centred(columns))
        return answers.view(*start.shape, -1)

    def _values(self) -> Tensor:
        """Return the constants [R, L, A]."""
        moved = self.unit * self.value
        if self.leaf_weight is not None:
            centre = self._of_leaf_terms(self.centre.squeeze(-1))
            moved = moved - (self.leaf_weight_unit * self.leaf_weight * centre).sum(2)
        return self.first_value + moved

    def _leaf_weights(self) -> Tensor:
        """Return the weights [R, L, Q, A] of the linear terms, 0 for padding."""
        if self.leaf_weight is None:
            return self.first_leaf_weight
        return self.first_leaf_weight + self.leaf_weight_unit * self.leaf_weight

    def _dense(self, n_features: int) -> Tensor:
        """Return what one unit of each feature adds to each value, [R, L, A, D]."""
        weights = self._leaf_weights().mT
        dense = weights.new_zeros((*weights.shape[:3], n_features))
        return dense.scatter_add(3, self.leaf_feature.unsqueeze(2).expand_as(weights), weights)

    def _of_leaf_terms(self, of_features: Tensor) -> Tensor:
        """Return [R, L, Q, 1], what each linear term has of its feature, from [R, D] (or [R, 1] for all features)."""
        of_features = of_features.expand(-1, self._n_features)
        return of_features.gather(1, self.leaf_feature.flatten(1)).view(*self.leaf_feature.shape, 1)


def soften_values(
    trees: Sequence[DecisionTree],
    n_features: int,
    bounds: tuple[NDArray[np.float32], NDArray[np.float32]],
    sd: float = FIRST_SD,
    alpha: float = 1000.0,
    *,
    straight_through: bool = False,
) -> GaussianDDT:
    """Return the soft trees that start from trees with values.

    Args:
        trees: [R] trees.
        n_features: Number of features, D.
        bounds: [A] lower and upper bounds of actions. Changes are counted in halves of their distance; in 1 where there
            is none.
        sd: Standard deviation of what leaves draw, in these units.
        alpha: Steepness of every split.
        straight_through: As in `SoftSplits`.

    Raises:
        ValueError: A tree holds actions, or another number of values.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        half = (bounds[1] - bounds[0]) / 2
    unit = np.where(np.isfinite(half) & (half > 0), half, np.float32(1))
    return GaussianDDT(
        trees, n_features, torch.from_numpy(unit), sd, alpha, straight_through=straight_through
    )


def _check(trees: Sequence[DecisionTree], n_values: int) -> None:
    for tree in trees:
        if tree.value.shape[1] != n_values:
            raise ValueError(
                f"these soft trees are made of leaves with {n_values} values; got a tree with "
                f"{'actions' if tree.has_actions else f'{tree.value.shape[1]} values'}"
            )


def _linear_terms(
    trees: Sequence[DecisionTree], n_leaves: int
) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]:
    """Return features [R, L, Q] and weights [R, L, Q, A] of linear terms, and [R, L, Q], 1 where there is one."""
    numbers = padded([np.diff(tree.leaf_term_start) for tree in trees])
    n_terms = int(numbers.max())
    is_own = np.arange(n_terms) < numbers[..., np.newaxis]
    feature = np.zeros((len(trees), n_leaves, n_terms), np.int32)
    weight = np.zeros((*feature.shape, trees[0].value.shape[1]), np.float32)
    is_term = np.zeros(feature.shape, np.float32)
    for row, (tree, own) in enumerate(zip(trees, is_own, strict=True)):
        # A lone leaf's tree is padded by one more leaf, which has no terms.
        places = is_term[row, : len(own)]
        places[own] = 1
        feature[row, : len(own)][own] = tree.leaf_feature
        weight[row, : len(own)][own] = tree.leaf_weight
    return feature, weight, is_term
