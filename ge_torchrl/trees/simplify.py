"""Smaller trees that act the same: on what a validation visited, or on all that the bounds allow."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ge_torchrl.compilation import compiled
from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.decision_tree import DecisionTree, FloatArray, IntArray
from ge_torchrl.trees.forest import Forest

# Compiled code reads plain globals, not the attributes of a class.
_NO_CHILD, _NO_FEATURE, _NO_ACTION = DecisionTree.NO_CHILD, DecisionTree.NO_FEATURE, DecisionTree.NO_ACTION


def prune(tree: DecisionTree, visits: ArrayLike) -> DecisionTree:
    """Return the tree without unvisited nodes, then without decisions between equal leaves.

    It acts as the full tree on every observation that was visited. Source: thesis, appendix B.2.

    Args:
        tree: the tree.
        visits: [N] how often the validation episodes visited each node.

    Raises:
        InvalidTreeError: The visits are not those of this tree.
    """
    return merge_equal_leaves(prune_unvisited(tree, visits))


def prune_unvisited(tree: DecisionTree, visits: ArrayLike) -> DecisionTree:
    """Return the tree with every decision node that has an unvisited child replaced by its other child.

    Args:
        tree: the tree.
        visits: [N] how often the validation episodes visited each node.

    Returns:
        The pruned tree, nodes depth first.

    Raises:
        InvalidTreeError: The visits are not those of this tree.
    """
    visited = _visited(tree, visits)
    stands_for = np.arange(tree.n_nodes, dtype=np.int32)
    for node in reversed(_depth_first(0, tree.children_left, tree.children_right)):
        if not tree.is_leaf[node]:
            left, right = tree.children_left[node], tree.children_right[node]
            if not visited[right]:
                stands_for[node] = stands_for[left]
            elif not visited[left]:
                stands_for[node] = stands_for[right]
    return _rebuilt(
        tree,
        root=int(stands_for[0]),
        children_left=np.where(tree.is_leaf, tree.NO_CHILD, stands_for[tree.children_left]),
        children_right=np.where(tree.is_leaf, tree.NO_CHILD, stands_for[tree.children_right]),
        action=tree.action,
    )


def merge_equal_leaves(tree: DecisionTree) -> DecisionTree:
    """Return the tree with decisions between two leaves of one action replaced by it, until none is left.

    Args:
        tree: the tree.

    Returns:
        A tree that chooses the same action on every observation, nodes depth first.
    """
    action = tree.action.copy()
    for node in reversed(_depth_first(0, tree.children_left, tree.children_right)):
        if not tree.is_leaf[node]:
            of_left, of_right = action[tree.children_left[node]], action[tree.children_right[node]]
            # Where both children are decisions, both hold NO_ACTION, and so does this node.
            if of_left == of_right:
                action[node] = of_left
    merged = action != tree.NO_ACTION
    return _rebuilt(
        tree,
        root=0,
        children_left=np.where(merged, tree.NO_CHILD, tree.children_left),
        children_right=np.where(merged, tree.NO_CHILD, tree.children_right),
        action=action,
    )


def simplify_exact(tree: DecisionTree, low: ArrayLike, high: ArrayLike) -> DecisionTree:
    """Return the tree without what no observation within the bounds can reach; see `simplify_forest`."""
    return simplify_forest(Forest.stack([tree]), low, high).tree(0)


def simplify_forest(forest: Forest, low: ArrayLike, high: ArrayLike) -> Forest:
    """Return the trees without what no observation can reach and without decisions between equal subtrees.

    The observations are the float32 vectors with `low <= observation <= high`. On each of them a tree chooses
    what it chose before; every leaf that remains is chosen for some of them; a second pass changes nothing.

    Args:
        forest: `P` trees, some of them possibly missing.
        low: [D] float32, least observation, may be -inf.
        high: [D] float32, greatest observation, may be inf.

    Returns:
        The simplified trees, nodes depth first; a missing tree stays missing.

    Raises:
        InvalidTreeError: The bounds are out of order, or a tree uses a feature that they do not have.
    """
    # One memory layout is one compilation of the kernel.
    least, greatest = (np.ascontiguousarray(bound, dtype=np.float32) for bound in (low, high))
    if least.ndim != 1 or least.shape != greatest.shape or not (least <= greatest).all():
        raise InvalidTreeError(f"bounds must be two vectors with low <= high, not {least} and {greatest}")
    if forest.feature.max(initial=-1) >= len(least):
        raise InvalidTreeError(
            f"the bounds are those of {len(least)} features; a tree uses feature {forest.feature.max()}"
        )
    # The next float32 makes the upper bound exclusive. Behind the largest one comes inf, which serves too, as
    # every threshold is finite.
    with np.errstate(over="ignore"):
        ceiling = np.nextafter(greatest, np.float32(np.inf))
    nodes = _Nodes(
        forest.feature, forest.threshold, forest.children_left, forest.children_right, forest.action
    )
    offsets, simplified = _simplify(forest.offsets, nodes, least, ceiling)
    return Forest(offsets, *simplified)


class _Nodes(NamedTuple):
    """The arrays of a forest's nodes, [M] each."""

    feature: IntArray
    threshold: FloatArray
    children_left: IntArray
    children_right: IntArray
    action: IntArray


@compiled
def _simplify(
    offsets: NDArray[np.int64], nodes: _Nodes, low: FloatArray, ceiling: FloatArray
) -> tuple[NDArray[np.int64], _Nodes]:
    """Walk every tree once, depth first, and write the nodes that matter.

    Observations of feature `f` lie in `[least[f], bound[f])`. The lower end always belongs to it, so a split
    is open exactly where `least < threshold < bound`: the least value goes left, the threshold itself right.
    """
    out_offsets, out = np.zeros_like(offsets), _empty_nodes(len(nodes.feature))
    least, bound = low.copy(), ceiling.copy()
    # For each open split: its row, its right child until the walk turns to it, and the end of the feature's
    # interval to put back.
    capacity = len(nodes.feature) // 2 + 1
    rows, rights = np.empty(capacity, np.int64), np.empty(capacity, np.int32)
    saved = np.empty(capacity, np.float32)
    end = 0
    for p in range(len(offsets) - 1):
        first, depth, node = end, 0, offsets[p]
        walking = node < offsets[p + 1]
        while walking:
            while nodes.children_left[node] != _NO_CHILD:
                f, t = nodes.feature[node], nodes.threshold[node]
                if least[f] < t < bound[f]:
                    _write(out, end, f, t, _NO_ACTION)
                    out.children_left[end] = end + 1 - first
                    rows[depth], rights[depth], saved[depth] = end, nodes.children_right[node], bound[f]
                    bound[f] = t
                    depth += 1
                    end += 1
                goes_left = least[f] < t
                node = offsets[p] + (nodes.children_left[node] if goes_left else nodes.children_right[node])
            _write(out, end, _NO_FEATURE, 0.0, nodes.action[node])
            end += 1
            while depth > 0 and rights[depth - 1] == _NO_CHILD:
                depth -= 1
                least[out.feature[rows[depth]]] = saved[depth]
                end = _without_equal_halves(out, rows[depth], end, first)
            walking = depth > 0
            if walking:
                row = rows[depth - 1]
                f = out.feature[row]
                bound[f], saved[depth - 1], least[f] = saved[depth - 1], least[f], out.threshold[row]
                out.children_right[row] = end - first
                node, rights[depth - 1] = offsets[p] + rights[depth - 1], _NO_CHILD
        out_offsets[p + 1] = end
    return out_offsets, _Nodes(
        out.feature[:end],
        out.threshold[:end],
        out.children_left[:end],
        out.children_right[:end],
        out.action[:end],
    )


@compiled
def _empty_nodes(size: int) -> _Nodes:
    return _Nodes(
        np.empty(size, np.int32),
        np.empty(size, np.float32),
        np.empty(size, np.int32),
        np.empty(size, np.int32),
        np.empty(size, np.int32),
    )


@compiled
def _write(out: _Nodes, row: int, feature: int, threshold: float, action: int) -> None:
    """Write a leaf, or a split whose children are not known yet."""
    out.feature[row] = feature
    out.threshold[row] = threshold
    out.children_left[row] = _NO_CHILD
    out.children_right[row] = _NO_CHILD
    out.action[row] = action


@compiled
def _without_equal_halves(out: _Nodes, row: int, end: int, first: int) -> int:
    """Replace the split at `row` by its left subtree if both are equal; return the new end of the rows.

    The tree begins at row `first`, the split's subtrees fill the rows up to `end`. Depth first, features,
    thresholds and actions fix the shape too, so children need no comparison.
    """
    right = first + out.children_right[row]
    size = right - row - 1
    if end - right != size:
        return end
    for i in range(row + 1, right):
        j = i + size
        if (
            out.feature[i] != out.feature[j]
            or out.threshold[i] != out.threshold[j]
            or out.action[i] != out.action[j]
        ):
            return end
    for i in range(row, row + size):
        _write(out, i, out.feature[i + 1], out.threshold[i + 1], out.action[i + 1])
        if out.children_left[i + 1] != _NO_CHILD:
            out.children_left[i] = out.children_left[i + 1] - 1
            out.children_right[i] = out.children_right[i + 1] - 1
    merged: int = row + size
    return merged


def _visited(tree: DecisionTree, visits: ArrayLike) -> NDArray[np.bool_]:
    counts = np.asarray(visits)
    if counts.shape != (tree.n_nodes,):
        raise InvalidTreeError(
            f"visits must be one count for each of {tree.n_nodes} nodes, not {counts.shape}"
        )
    visited: NDArray[np.bool_] = counts > 0
    if not visited[0]:
        raise InvalidTreeError(
            "every episode visits the root, but these visits do not: nothing was validated"
        )
    lost = visited & ~tree.is_leaf & ~visited[tree.children_left] & ~visited[tree.children_right]
    if lost.any():
        raise InvalidTreeError(
            f"node {int(np.argmax(lost))} was visited but neither child: the visits are of another tree"
        )
    return visited


def _rebuilt(
    tree: DecisionTree,
    root: int,
    children_left: NDArray[np.int32],
    children_right: NDArray[np.int32],
    action: NDArray[np.int32],
) -> DecisionTree:
    """Return the tree of the nodes that `root` reaches by these children, numbered depth first."""
    order = _depth_first(root, children_left, children_right)
    # NO_CHILD, -1, reads the entry behind the last node, which stays NO_CHILD.
    number = np.full(tree.n_nodes + 1, tree.NO_CHILD, dtype=np.int32)
    number[order] = np.arange(len(order))
    leaf = children_left[order] == tree.NO_CHILD
    return DecisionTree(
        feature=np.where(leaf, tree.NO_FEATURE, tree.feature[order]),
        threshold=np.where(leaf, np.float32(0), tree.threshold[order]),
        children_left=number[children_left[order]],
        children_right=number[children_right[order]],
        action=action[order],
    )


def _depth_first(root: int, children_left: IntArray, children_right: IntArray) -> list[int]:
    """Return the nodes that `root` reaches, a node before its children, left before right."""
    order: list[int] = []
    open_nodes = [root]
    while open_nodes:
        node = open_nodes.pop()
        order.append(node)
        if children_left[node] != DecisionTree.NO_CHILD:
            open_nodes += [int(children_right[node]), int(children_left[node])]
    return order
