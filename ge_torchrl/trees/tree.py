"""The one tree type of the package: a structure, and all its numbers as one vector."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.arrays import (
    FloatArray,
    IntArray,
    TreeArrays,
    depth_of,
    is_axis_aligned,
    joined,
    structure_of,
    visits_of_splits,
    without_splits,
    without_values,
)
from ge_torchrl.trees.checking import as_floats, as_ints, checked
from ge_torchrl.trees.deciding import answers, leaves_of
from ge_torchrl.trees.parameters import parameters_of, units_of, with_parameters

__all__ = ["DecisionTree", "FloatArray", "IntArray"]


@dataclass(frozen=True, eq=False)
class DecisionTree:
    """A decision tree of `M` splits and `L = M + 1` leaves; the root is split 0, or leaf 0 where there is no split.

    A split goes left where a weighted sum of features is below its threshold. A leaf holds the number of an
    action, or values, to each of which a linear function of the features may be added.

    Splits and leaves are numbered apart, each depth first, left before right; arrays that number them otherwise are
    renumbered. A child at or above 0 is a split, one below 0 is the leaf `~child`. Arrays are read-only copies.

    Attributes:
        children_left: [M] int32, the child where `sum < threshold`.
        children_right: [M] int32, the other child.
        term_start: [M + 1] int32; split `m` sums over the terms `term_start[m]` to `term_start[m + 1]`, at least one.
        feature: [K] int32, the feature of each term.
        weight: [K] float32, the weight of each term.
        threshold: [M] float32.
        action: [L] int32, the action of each leaf; [0] where leaves hold values.
        value: [L, A] float32, the values of each leaf; [L, 0] where leaves hold actions.
        leaf_term_start: [L + 1] int32; leaf `l` adds the terms `leaf_term_start[l]` to `leaf_term_start[l + 1]`.
        leaf_feature: [Q] int32, the feature of each of these terms.
        leaf_weight: [Q, A] float32, their weights, one for each value.

    Raises:
        InvalidTreeError: The arrays do not describe one tree.
    """

    children_left: IntArray
    children_right: IntArray
    term_start: IntArray
    feature: IntArray
    weight: FloatArray
    threshold: FloatArray
    action: IntArray
    value: FloatArray
    leaf_term_start: IntArray
    leaf_feature: IntArray
    leaf_weight: FloatArray

    def __post_init__(self) -> None:
        self.__dict__.update(_read_only(checked(self.arrays)))
        del self.__dict__["arrays"]

    @classmethod
    def unchecked(cls, arrays: TreeArrays) -> DecisionTree:
        """Return the tree of arrays that are known to be a tree's, in their types and depth first; it keeps them."""
        tree = cls.__new__(cls)
        tree.__dict__.update(_read_only(arrays))
        return tree

    @classmethod
    def leaf(cls, action: int) -> DecisionTree:
        """Return the tree that always answers `action`."""
        return cls.axis_aligned([], [], [], [], [action])

    @classmethod
    def value_leaf(
        cls, value: Sequence[float], linear: Mapping[int, Sequence[float]] | None = None
    ) -> DecisionTree:
        """Return the tree that always answers `value`, and linear terms added to it.

        Args:
            value: [A] the constants.
            linear: For each feature of a term, its weights [A].
        """
        terms = linear or {}
        values = as_floats("value", [value], n_dimensions=2)
        weights = np.array(list(terms.values())).reshape(len(terms), -1 if terms else values.shape[1])
        leaf_feature = as_ints("leaf_feature", list(terms))
        leaf_weight = as_floats("leaf_weight", weights, n_dimensions=2)
        return cls(*without_splits(values, leaf_feature, leaf_weight))

    @classmethod
    def split(cls, feature: int, threshold: float, left: DecisionTree, right: DecisionTree) -> DecisionTree:
        """Return the tree that goes to `left` where `observation[feature] < threshold`, else to `right`."""
        return cls.weighted_split([feature], [1.0], threshold, left, right)

    @classmethod
    def weighted_split(
        cls,
        feature: Sequence[int],
        weight: Sequence[float],
        threshold: float,
        left: DecisionTree,
        right: DecisionTree,
    ) -> DecisionTree:
        """Return the tree that goes to `left` where a weighted sum of features is below the threshold.

        Args:
            feature: [k] the features, at least one.
            weight: [k] their weights.
            threshold: What the sum is compared with.
            left: The tree where the sum is below it.
            right: The tree where it is not.
        """
        if left.value.shape[1] != right.value.shape[1]:
            raise InvalidTreeError(
                f"both halves of a tree must hold actions, or equally many values; they hold "
                f"{left.value.shape[1]} and {right.value.shape[1]} values a leaf (0: actions)"
            )
        features, weights = as_ints("feature", feature), as_floats("weight", weight)
        if len(features) == 0 or len(features) != len(weights) or features.min() < 0:
            raise InvalidTreeError(
                "a split needs at least one feature, each at or above 0 and with a weight; "
                f"it has features {features.tolist()} and weights {weights.tolist()}"
            )
        thresholds = as_floats("threshold", [threshold])
        return cls.unchecked(joined(features, weights, thresholds, left.arrays, right.arrays))

    @classmethod
    def axis_aligned(
        cls,
        feature: ArrayLike,
        threshold: ArrayLike,
        children_left: ArrayLike,
        children_right: ArrayLike,
        action: ArrayLike,
    ) -> DecisionTree:
        """Return the tree whose splits compare one feature each and whose leaves hold actions.

        Args:
            feature: [M].
            threshold: [M].
            children_left: [M], at or above 0 a split, below 0 the leaf `~child`.
            children_right: [M].
            action: [L].
        """
        arrays = without_values(
            as_ints("children_left", children_left),
            as_ints("children_right", children_right),
            as_ints("feature", feature),
            as_floats("threshold", threshold),
            as_ints("action", action),
        )
        return cls(*arrays)

    @cached_property
    def arrays(self) -> TreeArrays:
        """All arrays of the tree."""
        return TreeArrays(*(getattr(self, field.name) for field in fields(self)))

    @property
    def num_decision_nodes(self) -> int:
        """Number of splits, `M`."""
        return len(self.threshold)

    @property
    def num_leaves(self) -> int:
        """Number of leaves, `L = M + 1`."""
        return len(self.value)

    @cached_property
    def depth(self) -> int:
        """Largest number of splits on a path from the root to a leaf; 0 for a lone leaf."""
        return depth_of(self.arrays)

    @cached_property
    def is_axis_aligned(self) -> bool:
        """Whether every split compares one feature, of weight 1."""
        return is_axis_aligned(self.arrays)

    @property
    def has_actions(self) -> bool:
        """Whether leaves hold actions; if not, they hold values."""
        return len(self.action) > 0

    @cached_property
    def structure(self) -> bytes:
        """All but the parameters: equal for trees that differ in their numbers alone. Actions belong to it."""
        return structure_of(self.arrays)

    @cached_property
    def parameters(self) -> FloatArray:
        """[N] float32, all numbers of the tree.

        In this order: thresholds, weights of splits with more than one term, values, weights of linear terms.
        """
        numbers = parameters_of(self.arrays)
        numbers.flags.writeable = False
        return numbers

    def with_parameters(self, parameters: ArrayLike) -> DecisionTree:
        """Return the tree of the same structure with other numbers.

        Args:
            parameters: [N] as in `parameters`.

        Raises:
            InvalidTreeError: There are more or fewer, or one is no finite float32.
        """
        numbers = as_floats("parameters", parameters)
        if len(numbers) != len(self.parameters):
            raise InvalidTreeError(
                f"this tree has {len(self.parameters)} parameters; {len(numbers)} were given"
            )
        return DecisionTree.unchecked(with_parameters(self.arrays, numbers))

    def with_actions(self, actions: ArrayLike) -> DecisionTree:
        """Return the tree with other actions at its leaves, [L].

        Raises:
            InvalidTreeError: There are more or fewer, one is below 0, or the leaves hold values.
        """
        numbers = as_ints("action", actions)
        if not self.has_actions or len(numbers) != self.num_leaves or numbers.min() < 0:
            raise InvalidTreeError(
                f"this tree takes {len(self.action)} actions, each at least 0; {numbers.tolist()} were given"
            )
        return DecisionTree.unchecked(self.arrays._replace(action=numbers))

    def parameter_units(
        self, spread: NDArray[np.float64], action_spread: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """Return a natural step of each parameter, [N], above 0.

        A threshold's step is how far its sum spreads, if features spread independently; a weight's step moves the sum
        as far. A value's step is how far it spreads itself, and the step of a linear weight moves it as far.

        Args:
            spread: [D] how far each feature spreads, above 0.
            action_spread: [A] likewise each value, as in `Names.action_spread`; None: 1. Leaves with actions have none.
        """
        return units_of(self.arrays, spread, None if self.has_actions else action_spread)

    def split_visits(self, leaf_visits: ArrayLike) -> NDArray[np.int64]:
        """Return how often each split is visited, [M], from the visits of leaves, [L]."""
        return visits_of_splits(self.arrays, np.asarray(leaf_visits, np.int64))

    def decide(self, observations: ArrayLike) -> NDArray[Any]:
        """Return the answer of the tree to every observation.

        Args:
            observations: [B, D] float32.

        Returns:
            [B] int32, the actions; [B, A] float32, the values, where leaves hold values.
        """
        observed = np.asarray(observations, dtype=np.float32)
        return answers(self.arrays, self.leaf_of(observed), observed)

    def leaf_of(self, observations: ArrayLike) -> IntArray:
        """Return the leaf that every observation ends in; NaN goes right.

        Args:
            observations: [B, D] float32.

        Returns:
            [B] int32, numbers of leaves.
        """
        return leaves_of(self.arrays, self.depth, np.asarray(observations, dtype=np.float32))

    @cached_property
    def _bytes(self) -> bytes:
        return self.structure + self.parameters.tobytes()

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, DecisionTree):
            return NotImplemented
        return self._bytes == other._bytes

    def __hash__(self) -> int:
        return hash(self._bytes)


def _read_only(arrays: TreeArrays) -> dict[str, Any]:
    for array in arrays:
        array.flags.writeable = False
    return arrays._asdict()
