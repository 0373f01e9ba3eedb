"""Many trees in one bundle of arrays: what mapping, simplification, edits and compiled kernels read and write."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.arrays import FloatArray, ForestArrays, IntArray, TreeArrays, structure_of
from ge_torchrl.trees.deciding import decide_axis_aligned, decide_weighted
from ge_torchrl.trees.parameters import has_free_weight
from ge_torchrl.trees.rows import gather, starts
from ge_torchrl.trees.tree import DecisionTree

__all__ = ["Forest", "ForestArrays"]

_Number = TypeVar("_Number", bound=np.generic)


@dataclass(frozen=True, eq=False)
class Forest:
    """`P` individuals, each with a tree or, where a genotype is invalid, without one.

    Nothing is checked here: a forest comes from checked trees, or from a mapping whose law is to make valid ones,
    depth first. Nobody writes to the arrays of a forest.

    Attributes:
        arrays: The arrays of all trees.
    """

    arrays: ForestArrays

    @classmethod
    def stack(cls, trees: Sequence[DecisionTree]) -> Forest:
        """Return the forest of these trees, in their order.

        Raises:
            InvalidTreeError: A tree's leaves hold values.
        """
        if not all(tree.has_actions for tree in trees):
            which = [tree.has_actions for tree in trees].index(False)
            raise InvalidTreeError(
                f"a forest takes trees whose leaves hold actions; those of tree {which} hold values"
            )
        # The empty arrays in front let a forest of no trees be stacked too.
        no_ints, no_floats = np.zeros(0, np.int32), np.zeros(0, np.float32)
        n_terms = [np.diff(tree.term_start) for tree in trees]
        return cls(
            ForestArrays(
                split_start=starts([len(tree.threshold) for tree in trees]),
                leaf_start=starts([len(tree.action) for tree in trees]),
                term_start=starts(np.concatenate([no_ints, *n_terms])),
                feature=np.concatenate([no_ints, *(tree.feature for tree in trees)]),
                weight=np.concatenate([no_floats, *(tree.weight for tree in trees)]),
                threshold=np.concatenate([no_floats, *(tree.threshold for tree in trees)]),
                children_left=np.concatenate([no_ints, *(tree.children_left for tree in trees)]),
                children_right=np.concatenate([no_ints, *(tree.children_right for tree in trees)]),
                action=np.concatenate([no_ints, *(tree.action for tree in trees)]),
            )
        )

    @classmethod
    def axis_aligned(
        cls,
        split_start: NDArray[np.int64],
        leaf_start: NDArray[np.int64],
        feature: IntArray,
        threshold: FloatArray,
        children_left: IntArray,
        children_right: IntArray,
        action: IntArray,
    ) -> Forest:
        """Return the forest of trees whose splits compare one feature each; arguments as in `ForestArrays`."""
        n_splits = len(feature)
        return cls(
            ForestArrays(
                split_start=split_start,
                leaf_start=leaf_start,
                term_start=np.arange(n_splits + 1),
                feature=feature,
                weight=np.ones(n_splits, np.float32),
                threshold=threshold,
                children_left=children_left,
                children_right=children_right,
                action=action,
            )
        )

    @classmethod
    def of_parameters(cls, tree: DecisionTree, parameters: NDArray[np.float32]) -> Forest:
        """Return copies of one tree with other numbers.

        Args:
            tree: A tree of N parameters whose leaves hold actions.
            parameters: [R, N] float32, finite, as in `DecisionTree.parameters`.

        Raises:
            InvalidTreeError: The tree has another number of parameters, or its leaves hold values.
        """
        if not tree.has_actions or parameters.ndim != 2 or parameters.shape[1] != len(tree.parameters):
            raise InvalidTreeError(
                f"copies of a tree with actions need [R, {len(tree.parameters)}] parameters; "
                f"{list(parameters.shape)} were given"
            )
        copies, n_splits, n_terms = len(parameters), tree.num_decision_nodes, len(tree.feature)
        # As in a tree: adding zero makes -0.0 into 0.0.
        numbers = parameters.astype(np.float32) + np.float32(0.0)
        weight = _repeated(tree.weight, copies)
        if len(tree.parameters) > n_splits:
            weight[:, has_free_weight(tree.arrays)] = numbers[:, n_splits:]
        return cls(
            ForestArrays(
                split_start=np.arange(copies + 1) * n_splits,
                leaf_start=np.arange(copies + 1) * tree.num_leaves,
                term_start=np.append(
                    (np.arange(copies)[:, np.newaxis] * n_terms + tree.term_start[:-1]).reshape(-1),
                    copies * n_terms,
                ),
                feature=_repeated(tree.feature, copies).reshape(-1),
                weight=weight.reshape(-1),
                threshold=np.ascontiguousarray(numbers[:, :n_splits]).reshape(-1),
                children_left=_repeated(tree.children_left, copies).reshape(-1),
                children_right=_repeated(tree.children_right, copies).reshape(-1),
                action=_repeated(tree.action, copies).reshape(-1),
            )
        )

    @classmethod
    def concatenate(cls, forests: Sequence[Forest]) -> Forest:
        """Return the individuals of all forests, in their order."""
        all_arrays = [forest.arrays for forest in (_NO_TREES, *forests)]

        def joined_starts(name: str) -> NDArray[np.int64]:
            return starts(np.concatenate([np.diff(getattr(arrays, name)) for arrays in all_arrays]))

        return cls(
            ForestArrays(
                split_start=joined_starts("split_start"),
                leaf_start=joined_starts("leaf_start"),
                term_start=joined_starts("term_start"),
                feature=np.concatenate([arrays.feature for arrays in all_arrays]),
                weight=np.concatenate([arrays.weight for arrays in all_arrays]),
                threshold=np.concatenate([arrays.threshold for arrays in all_arrays]),
                children_left=np.concatenate([arrays.children_left for arrays in all_arrays]),
                children_right=np.concatenate([arrays.children_right for arrays in all_arrays]),
                action=np.concatenate([arrays.action for arrays in all_arrays]),
            )
        )

    def take(self, index: ArrayLike) -> Forest:
        """Return some individuals, in the order asked for.

        Args:
            index: [Q] their numbers, each as often as it is wanted.
        """
        arrays = self.arrays
        split_start, splits = gather(arrays.split_start, index)
        leaf_start, leaves = gather(arrays.leaf_start, index)
        if len(arrays.feature) > len(arrays.threshold):
            term_start, terms = gather(arrays.term_start, splits)
        else:
            term_start, terms = np.arange(len(splits) + 1), splits
        return Forest(
            ForestArrays(
                split_start=split_start,
                leaf_start=leaf_start,
                term_start=term_start,
                feature=arrays.feature[terms],
                weight=arrays.weight[terms],
                threshold=arrays.threshold[splits],
                children_left=arrays.children_left[splits],
                children_right=arrays.children_right[splits],
                action=arrays.action[leaves],
            )
        )

    def __len__(self) -> int:
        return len(self.arrays.split_start) - 1

    @cached_property
    def valid(self) -> NDArray[np.bool_]:
        """[P] bool, where an individual has a tree."""
        return np.diff(self.arrays.leaf_start) > 0

    @cached_property
    def num_decision_nodes(self) -> NDArray[np.int64]:
        """[P] int64, number of splits of each tree, 0 where there is none."""
        return np.diff(self.arrays.split_start)

    @cached_property
    def is_axis_aligned(self) -> bool:
        """Whether every split of every tree compares one feature, of weight 1: kernels are quicker then."""
        arrays = self.arrays
        return len(arrays.feature) == len(arrays.threshold) and bool((arrays.weight == 1).all())

    def tree(self, index: int) -> DecisionTree:
        """Return one tree.

        Args:
            index: Number of the individual, 0 to P - 1.

        Raises:
            IndexError: There is no such individual.
            InvalidTreeError: The individual has no tree.
        """
        rows = self._rows(index)
        if len(rows.action) == 0:
            raise InvalidTreeError(f"individual {index} has no tree: its genotype is invalid")
        return DecisionTree.unchecked(TreeArrays._make(array.copy() for array in rows))

    def trees(self) -> list[DecisionTree]:
        """Return all trees; every individual must have one."""
        return [self.tree(index) for index in range(len(self))]

    def structure(self, index: int) -> bytes:
        """Return the `DecisionTree.structure` of one tree; empty where there is none."""
        rows = self._rows(index)
        return structure_of(rows) if len(rows.action) > 0 else b""

    def _rows(self, index: int) -> TreeArrays:
        """Return views of one tree's rows."""
        if not 0 <= index < len(self):
            raise IndexError(f"the forest has individuals 0 to {len(self) - 1}, not {index}")
        arrays = self.arrays
        first, end = int(arrays.split_start[index]), int(arrays.split_start[index + 1])
        action = arrays.action[arrays.leaf_start[index] : arrays.leaf_start[index + 1]]
        term_start = arrays.term_start[first : end + 1]
        terms = slice(term_start[0], term_start[-1])
        return TreeArrays(
            children_left=arrays.children_left[first:end],
            children_right=arrays.children_right[first:end],
            term_start=(term_start - term_start[0]).astype(np.int32),
            feature=arrays.feature[terms],
            weight=arrays.weight[terms],
            threshold=arrays.threshold[first:end],
            action=action,
            value=np.zeros((len(action), 0), np.float32),
            leaf_term_start=np.zeros(len(action) + 1, np.int32),
            leaf_feature=_NO_INTS,
            leaf_weight=_NO_LEAF_WEIGHTS,
        )

    def decide(self, tree_index: NDArray[np.int64], observations: NDArray[np.float32]) -> IntArray:
        """Return the action of each observation, every one decided by its own tree.

        Args:
            tree_index: [B] int64, which tree decides; it must have a tree.
            observations: [B, D] float32.

        Returns:
            [B] int32, the actions.
        """
        actions = np.empty(len(tree_index), np.int32)
        decide = decide_axis_aligned if self.is_axis_aligned else decide_weighted
        decide(self.arrays, tree_index, np.ascontiguousarray(observations, np.float32), actions)
        return actions


def _repeated(array: NDArray[_Number], copies: int) -> NDArray[_Number]:
    """Return [copies, n]; unlike `np.tile`, never a view of what is read-only."""
    return np.repeat(array[np.newaxis], copies, axis=0)


_NO_INTS = np.zeros(0, np.int32)
_NO_LEAF_WEIGHTS = np.zeros((0, 0), np.float32)
_NO_TREES = Forest.stack([])
