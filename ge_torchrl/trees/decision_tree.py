"""The one tree type of the package: an orthogonal decision tree as parallel arrays."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ge_torchrl.errors import InvalidTreeError

IntArray = NDArray[np.int32]
FloatArray = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class DecisionTree:
    """An orthogonal decision tree; at node `j` go left where `observation[feature[j]] < threshold[j]`.

    Arrays follow scikit-learn's conventions, `N` nodes, root 0. They are copied and read-only.

    Attributes:
        feature: [N] int32, the observed feature of a decision node, `NO_FEATURE` at a leaf.
        threshold: [N] float32, the threshold of a decision node, 0 at a leaf.
        children_left: [N] int32, the node for TRUE, `NO_CHILD` at a leaf.
        children_right: [N] int32, the node for FALSE, `NO_CHILD` at a leaf.
        action: [N] int32, the action of a leaf, `NO_ACTION` at a decision node.

    Raises:
        InvalidTreeError: The arrays do not describe one tree with root 0.
    """

    NO_CHILD: ClassVar[int] = -1
    NO_FEATURE: ClassVar[int] = -1
    NO_ACTION: ClassVar[int] = -1

    feature: IntArray
    threshold: FloatArray
    children_left: IntArray
    children_right: IntArray
    action: IntArray

    def __post_init__(self) -> None:
        for field in fields(self):
            array = _as_array(field.name, getattr(self, field.name))
            array.flags.writeable = False
            object.__setattr__(self, field.name, array)
        _check_arrays(self)

    @classmethod
    def leaf(cls, action: int) -> DecisionTree:
        """Return the tree that always answers `action`."""
        return cls(
            feature=_ints([cls.NO_FEATURE]),
            threshold=np.zeros(1, np.float32),
            children_left=_ints([cls.NO_CHILD]),
            children_right=_ints([cls.NO_CHILD]),
            action=_ints([action]),
        )

    @classmethod
    def split(cls, feature: int, threshold: float, left: DecisionTree, right: DecisionTree) -> DecisionTree:
        """Return the tree that goes to `left` where `observation[feature] < threshold`, else to `right`.

        Nodes are numbered depth first, left before right, as the grammar's mapping numbers them.
        """

        def shifted(children: IntArray, by: int) -> IntArray:
            return np.where(children == cls.NO_CHILD, cls.NO_CHILD, children + by).astype(np.int32)

        return cls(
            feature=np.concatenate([_ints([feature]), left.feature, right.feature]),
            threshold=np.concatenate([_as_array("threshold", [threshold]), left.threshold, right.threshold]),
            children_left=np.concatenate(
                [_ints([1]), shifted(left.children_left, 1), shifted(right.children_left, 1 + left.n_nodes)]
            ),
            children_right=np.concatenate(
                [
                    _ints([1 + left.n_nodes]),
                    shifted(left.children_right, 1),
                    shifted(right.children_right, 1 + left.n_nodes),
                ]
            ),
            action=np.concatenate([_ints([cls.NO_ACTION]), left.action, right.action]),
        )

    @property
    def n_nodes(self) -> int:
        """Number of nodes, decision nodes and leaves together."""
        return len(self.feature)

    @property
    def is_leaf(self) -> NDArray[np.bool_]:
        """[N] bool, where a node is a leaf."""
        leaves: NDArray[np.bool_] = self.children_left == self.NO_CHILD
        return leaves

    @property
    def n_decision_nodes(self) -> int:
        """Number of decision nodes; a tree has one leaf more."""
        return self.n_nodes // 2

    @property
    def structure(self) -> bytes:
        """What stays of the tree without its thresholds; equal for trees of one structure, numbered depth first."""
        return self.feature.tobytes() + self.action.tobytes()

    @cached_property
    def depth(self) -> int:
        """Largest number of decisions on a path from the root to a leaf; 0 for a lone leaf."""
        deepest, level = 0, [0]
        while level := [
            int(child)
            for node in level
            if self.children_left[node] != self.NO_CHILD
            for child in (self.children_left[node], self.children_right[node])
        ]:
            deepest += 1
        return deepest

    def decide(self, observations: ArrayLike) -> IntArray:
        """Return the action of every observation.

        Args:
            observations: [B, D] float32.

        Returns:
            [B] int32, the actions.
        """
        return self.action[self.leaf_of(observations)]

    def leaf_of(self, observations: ArrayLike) -> IntArray:
        """Return the leaf that every observation ends in.

        Args:
            observations: [B, D] float32.

        Returns:
            [B] int32, indices of leaves.
        """
        observed = np.asarray(observations, dtype=np.float32)
        rows = np.arange(len(observed))
        node = np.zeros(len(observed), dtype=np.int32)
        for _ in range(self.depth):
            # A leaf keeps its observation; its feature, -1, reads a value that is then not used.
            left = observed[rows, self.feature[node]] < self.threshold[node]
            child = np.where(left, self.children_left[node], self.children_right[node])
            node = np.where(child == self.NO_CHILD, node, child)
        return node

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, DecisionTree):
            return NotImplemented
        return all(np.array_equal(getattr(self, f.name), getattr(other, f.name)) for f in fields(self))

    def __hash__(self) -> int:
        return hash(tuple(getattr(self, field.name).tobytes() for field in fields(self)))


def _ints(values: list[int]) -> IntArray:
    return np.array(values, dtype=np.int32)


def _as_array(name: str, values: ArrayLike) -> NDArray[np.int32 | np.float32]:
    """Copy into the field's type; refuse what would wrap, be cut off or be no number."""
    try:
        array = np.array(values, ndmin=1)
    except ValueError as error:
        raise InvalidTreeError(f"{name} must be one array of numbers: {error}") from error
    if array.size == 0:
        return np.zeros(array.shape, np.float32 if name == "threshold" else np.int32)
    if name == "threshold":
        if array.dtype.kind not in "fiu":
            raise InvalidTreeError(f"threshold must hold real numbers, not {array.dtype}")
        with np.errstate(over="ignore"):
            # Adding zero makes -0.0 into 0.0: they compare equal, so equal trees must hold the same bytes.
            return array.astype(np.float32) + np.float32(0.0)
    limits = np.iinfo(np.int32)
    if array.dtype.kind not in "iu" or array.min() < limits.min or array.max() > limits.max:
        raise InvalidTreeError(f"{name} must hold 32-bit integers, not {array.dtype} such as {array.flat[0]}")
    return array.astype(np.int32)


def _check_arrays(tree: DecisionTree) -> None:
    sizes = {field.name: getattr(tree, field.name).shape for field in fields(tree)}
    if len(set(sizes.values())) != 1 or len(tree.feature.shape) != 1 or tree.n_nodes == 0:
        raise InvalidTreeError(f"a tree needs five arrays of one length of at least 1; these have {sizes}")
    leaf = tree.is_leaf
    _refuse(leaf != (tree.children_right == tree.NO_CHILD), "has only one child")
    _refuse(leaf & (tree.action < 0), "is a leaf without an action")
    _refuse(leaf & (tree.feature != tree.NO_FEATURE), "is a leaf with a feature")
    _refuse(leaf & (tree.threshold != 0), "is a leaf with a threshold")
    _refuse(~leaf & (tree.action != tree.NO_ACTION), "is a decision node with an action")
    _refuse(~leaf & (tree.feature < 0), "is a decision node without a feature")
    _refuse(~np.isfinite(tree.threshold), "has a threshold that is not a finite number")
    children = np.concatenate([tree.children_left[~leaf], tree.children_right[~leaf]])
    out_of_range = (children < 1) | (children >= tree.n_nodes)
    if out_of_range.any():
        raise InvalidTreeError(
            f"children must be nodes 1 to {tree.n_nodes - 1} (the root is nobody's child); "
            f"one is {children[out_of_range][0]}"
        )
    parents = np.bincount(children, minlength=tree.n_nodes)
    parents[0] += 1
    _refuse(parents != 1, "does not have exactly one parent")
    # One parent each leaves only cycles apart from the root to be excluded.
    seen, open_nodes = 1, [0]
    while open_nodes:
        node = open_nodes.pop()
        if not leaf[node]:
            seen += 2
            open_nodes += [int(tree.children_left[node]), int(tree.children_right[node])]
    if seen != tree.n_nodes:
        raise InvalidTreeError(f"{tree.n_nodes - seen} nodes form a cycle that the root does not reach")


def _refuse(bad: NDArray[np.bool_], what: str) -> None:
    if bad.any():
        raise InvalidTreeError(f"node {int(np.argmax(bad))} {what}")
