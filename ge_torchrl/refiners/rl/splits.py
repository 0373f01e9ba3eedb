"""The soft splits of many trees: how much each of their paths weighs, and the numbers that a gradient moves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from ge_torchrl.trees.tree import DecisionTree

_Number = TypeVar("_Number", bound=np.generic)

# sigma(-1e30) is 0 in any precision, so nothing is lost where the argument of a sigmoid ends; without an end, a far
# threshold would give -inf, and 0 * -inf on the paths that do not pass it.
_LARGEST_LOGIT = 1e30
# Within these the sum of some hundred products is a float32.
LARGEST_FEATURE: Final = 1e24
LARGEST_WEIGHT: Final = 1e12
"""Of features and of weights in a batched product; what is larger counts as large as this."""


class SoftSplits(nn.Module):
    """The splits of `R` decision trees with soft decisions; their leaves are for those who derive from it.

    With `phi` the threshold and `s` the split's sum (one feature of an axis-aligned split), a split gives its TRUE
    (left) branch the weight `sigma(alpha (phi - s))` and its FALSE (right) branch `sigma(alpha (s - phi))`; a path
    weighs the product of its branches. Eq. 2 of the thesis prints `sigma(alpha (x - phi))`, the weight of the FALSE
    branch. At `s = phi`, where the hard tree goes right, each branch weighs exactly one half.

    `phi` and `s` are counted from `origin` in units of `scale`, and a weight in units that move its sum by about
    `scale`, so that one `alpha` and one learning rate suit features of any size. A weight turns its split around the
    mean of its feature. The hard tree is always in the features' own units.

    Trees are padded to the `M` splits (at least one) and `L = M + 1` leaves of the largest, and to `K` terms, 1 where
    all are axis-aligned and at least 2 elsewhere. Padding has no mass and no gradient.

    Args:
        trees: [R] trees; their structures and features stay as they are.
        alpha: Steepness of every split; an attribute that may be changed at any time.
        straight_through: Whether the hard path decides, and the soft paths give its gradient.

    Attributes:
        trees: The trees that these were made from.
        is_axis_aligned: Whether every split of every tree compares one feature, of weight 1.
        threshold: [R, M] float32 parameter, counted from `origin` in units of `scale`.
        weight: [R, M, K] float32 parameter, counted from `first_weight` in units of `weight_unit`; None where all
            splits are axis-aligned.
        feature: [R, M, K] int64 buffer.
        origin: [R, M] float32 buffer, the thresholds of `trees`.
        scale: [R, M] float32 buffer, 1 unless standardised.
        first_weight: [R, M, K] float32 buffer, the weights of `trees`, 0 for padding.
        weight_unit: [R, M, K] float32 buffer, 0 for a weight that is not free: of padding, or of a lone term.
        centre: [R, D, 1] float32 buffer, the means of features; [R, 1, 1] of 0 unless standardised.
        at_centre: [R, M] float32 buffer, how far the sums of `trees` lie below their thresholds there.
        is_left: [R, L, M] buffer, 1 where the path to the leaf takes the split's left branch, else 0.
        is_right: [R, L, M] buffer, likewise for the right branch.
        is_leaf: [R, L, 1] buffer, 1 for a leaf and 0 for padding.
    """

    feature: Tensor
    origin: Tensor
    scale: Tensor
    first_weight: Tensor
    weight_unit: Tensor
    centre: Tensor
    at_centre: Tensor
    is_left: Tensor
    is_right: Tensor
    is_leaf: Tensor
    weight: nn.Parameter | None

    def __init__(self, trees: Sequence[DecisionTree], alpha: float, *, straight_through: bool) -> None:
        super().__init__()
        self.trees = tuple(trees)
        self.alpha = alpha
        self.straight_through = straight_through
        self.is_axis_aligned = all(tree.is_axis_aligned for tree in trees)
        is_left, is_right, is_leaf = _paths(trees)
        self.register_buffer("is_left", torch.from_numpy(is_left))
        self.register_buffer("is_right", torch.from_numpy(is_right))
        self.register_buffer("is_leaf", torch.from_numpy(is_leaf))
        # Moves are what is trained, so that what has not moved comes back to the last bit.
        self.register_buffer("origin", torch.from_numpy(padded([t.threshold for t in trees])))
        self.threshold = nn.Parameter(torch.zeros_like(self.origin))
        self.register_buffer("scale", torch.ones_like(self.threshold))
        terms = _terms(trees, self.origin.shape[1], 1 if self.is_axis_aligned else 2)
        self.register_buffer("feature", torch.from_numpy(terms.feature).long())
        self.register_buffer("centre", torch.zeros(len(trees), 1, 1))
        if self.is_axis_aligned:
            self.register_parameter("weight", None)
            return
        self.register_buffer("first_weight", torch.from_numpy(terms.weight))
        self.register_buffer("weight_unit", torch.from_numpy(terms.is_free.astype(np.float32)))
        self.register_buffer("at_centre", self.origin.clone())
        self.weight = nn.Parameter(torch.zeros_like(self.first_weight))

    @property
    def num_trees(self) -> int:
        """Number of trees, R."""
        return len(self.trees)

    def log_weights(self, columns: Tensor) -> Tensor:
        """Return the logarithms [R, L, T] of the leaves' weights on observations [R, D, T]; padding is not masked."""
        logit = self._axis_logits(columns) if self.weight is None else self._oblique_logits(columns)
        log_left = functional.logsigmoid(logit)
        return torch.baddbmm(torch.bmm(self.is_left, log_left), self.is_right, log_left - logit)

    def weights(self, columns: Tensor) -> Tensor:
        """Return the weights [R, L, T] of the leaves on observations [R, D, T]; those of padding mean nothing."""
        weights = self.log_weights(columns).exp()
        if self.straight_through:
            # The value is the hard path's, the gradient that of the soft paths.
            weights = weights + (self._hard_weights(columns) - weights).detach()
        return weights

    def centred(self, columns: Tensor) -> Tensor:
        """Return observations [R, D, T] from the means of their features, in a range that sums bear."""
        return (columns - self.centre).clamp(-LARGEST_FEATURE, LARGEST_FEATURE)

    @torch.no_grad()
    def standardise(self, spread: Tensor, mean: Tensor | None = None) -> None:
        """Count the moves of numbers in units of their features' spread; the hard trees stay the same.

        Args:
            spread: [R, D], how far the values of each feature lie apart, above 0.
            mean: [R, D], around which they lie, where weights turn; None for 0.
        """
        if self.weight is None:
            moved = self.scale * self.threshold
            self.scale.copy_(spread.gather(1, self.feature[..., 0]))
            self.threshold.copy_(moved / self.scale)
            self.centre = (torch.zeros_like(spread) if mean is None else mean).unsqueeze(-1)
            return
        threshold, weight = self.thresholds() - self.origin, self.weight_unit * self.weight
        self.centre = (torch.zeros_like(spread) if mean is None else mean).unsqueeze(-1)
        of_term = self._of_terms(spread).double()
        of_sum = (self.first_weight * of_term).square().sum(-1).sqrt()
        # Where all weights are 0, the first feature is as good as any.
        of_sum = torch.where(of_sum > 0, of_sum, of_term[..., 0]).clamp(1e-30, 1e30)
        is_free = self.weight_unit > 0
        self.scale.copy_(of_sum)
        self.weight_unit.copy_(is_free * (of_sum.unsqueeze(-1) / of_term).clamp(1e-30, LARGEST_WEIGHT))
        self.weight.copy_(torch.where(is_free, weight / self.weight_unit, 0.0))
        at_centre = self._of_terms(self.centre.squeeze(-1)).double()
        self.at_centre.copy_(self.origin - (self.first_weight * at_centre).sum(-1))
        self.threshold.copy_((threshold - (weight * at_centre).sum(-1)) / self.scale)

    @torch.no_grad()
    def thresholds(self) -> Tensor:
        """Return the thresholds [R, M] in the units of their sums."""
        moved = self.scale * self.threshold
        if self.weight is None:
            return self.origin + moved
        turned = self.weight_unit * self.weight * self._of_terms(self.centre.squeeze(-1))
        return self.origin + (moved + turned.sum(-1))

    def split_weights(self) -> Tensor:
        """Return the weights [R, M, K] of the terms, 0 for padding."""
        if self.weight is None:
            return torch.ones(self.feature.shape, dtype=self.threshold.dtype)
        return self.first_weight + self.weight_unit * self.weight

    def hard_parts(self) -> dict[str, Tensor]:
        """Return the numbers [R, ...] of the hard trees, padded, by their names in `ForestArrays`."""
        thresholds = {"threshold": self.thresholds()}
        return thresholds if self.weight is None else {**thresholds, "weight": self.split_weights()}

    def _axis_logits(self, columns: Tensor) -> Tensor:
        """Return [R, M, T], how surely each split goes left: the argument of its sigmoid."""
        steepness = (self.alpha / self.scale).unsqueeze(-1)
        beyond = (
            (self._observed(columns) - self.origin.unsqueeze(-1))
            .mul_(steepness)
            .clamp_(-_LARGEST_LOGIT, _LARGEST_LOGIT)
        )
        return self.alpha * self.threshold.unsqueeze(-1) - beyond

    def _oblique_logits(self, columns: Tensor) -> Tensor:
        """Return the same of weighted sums."""
        steepness = self.alpha / self.scale
        # All features of a tree in one product: several times quicker than a gather of the terms.
        dense = self.origin.new_zeros((*self.origin.shape, columns.shape[1]))
        dense = dense.scatter_add(2, self.feature, self.split_weights())
        slope = (steepness.unsqueeze(-1) * dense).clamp(-LARGEST_WEIGHT, LARGEST_WEIGHT)
        # A weight that moves turns its split around the centre, so the threshold there moves by itself.
        start = (steepness * self.at_centre).clamp(-_LARGEST_LOGIT, _LARGEST_LOGIT)
        start = (start + self.alpha * self.threshold).unsqueeze(-1)
        logit = torch.baddbmm(start, slope, self.centred(columns), alpha=-1)
        return logit.clamp(-_LARGEST_LOGIT, _LARGEST_LOGIT)

    def _observed(self, columns: Tensor, term: int = 0) -> Tensor:
        """Return the features [R, M, T] of one term of each split."""
        row = self.feature[..., term] + columns.shape[1] * torch.arange(self.num_trees).unsqueeze(-1)
        return columns.flatten(0, 1).index_select(0, row.flatten()).view(*row.shape, -1)

    def _of_terms(self, of_features: Tensor) -> Tensor:
        """Return [R, M, K], what each term has of its feature, from [R, D] (or [R, 1] for all features)."""
        of_features = of_features.expand(-1, max(of_features.shape[1], int(self.feature.max()) + 1))
        return of_features.gather(1, self.feature.flatten(1)).view(self.feature.shape)

    @torch.no_grad()
    def _hard_weights(self, columns: Tensor) -> Tensor:
        """Return 1 for the leaf that the hard tree reaches and 0 for the others, [R, L, T]."""
        if self.weight is None:
            is_left = self._observed(columns) < self.thresholds().unsqueeze(-1)
        else:
            # As a tree does: in float64, in the order of the terms.
            sums, weights = torch.zeros((), dtype=torch.float64), self.split_weights().double()
            for term in range(self.feature.shape[2]):
                product = weights[..., term, None] * self._observed(columns, term)
                sums = sums + torch.where(weights[..., term, None] == 0, 0.0, product)
            is_left = sums < self.thresholds().double().unsqueeze(-1)
        goes_left = is_left.to(columns.dtype)
        wrong_turns = torch.bmm(self.is_left, 1 - goes_left) + torch.bmm(self.is_right, goes_left)
        return (wrong_turns == 0).to(columns.dtype)


def columns_of(observation: Tensor, num_trees: int, dtype: torch.dtype) -> Tensor:
    """Return observations [*S, D] of any number type as [R, D, T]: entries in columns are read as wholes."""
    rows = observation.to(dtype).reshape(num_trees, -1, observation.shape[-1])
    return rows.mT.contiguous()


def padded(rows: Sequence[NDArray[_Number]], filling: int = 0) -> NDArray[_Number]:
    """Return [R, N, ...], the rows filled up to the longest, and to one."""
    shape = (len(rows), max(1, *map(len, rows)), *rows[0].shape[1:])
    filled = np.full(shape, filling, rows[0].dtype)
    for place, row in zip(filled, rows, strict=True):
        place[: len(row)] = row
    return filled


class _Terms(NamedTuple):
    feature: NDArray[np.int32]
    weight: NDArray[np.float32]
    is_free: NDArray[np.bool_]


def _terms(trees: Sequence[DecisionTree], n_splits: int, at_least: int) -> _Terms:
    """Return the terms [R, M, K] of the splits, and which weights are parameters."""
    numbers = [np.diff(tree.term_start) for tree in trees]
    n_terms = max(at_least, *(int(own.max(initial=0)) for own in numbers))
    shape = (len(trees), n_splits, n_terms)
    terms = _Terms(np.zeros(shape, np.int32), np.zeros(shape, np.float32), np.zeros(shape, np.bool_))
    for row, (tree, number) in enumerate(zip(trees, numbers, strict=True)):
        is_own = np.arange(n_terms) < number[:, np.newaxis]
        terms.feature[row, : len(number)][is_own] = tree.feature
        terms.weight[row, : len(number)][is_own] = tree.weight
        terms.is_free[row, : len(number)] = is_own & (number > 1)[:, np.newaxis]
    return terms


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
