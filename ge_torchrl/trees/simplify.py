"""Smaller trees that act the same: on what a validation visited, or on all that the bounds allow."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.arrays import IntArray, depth_first, selected
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.reachable import Box, keep_what_is_reached
from ge_torchrl.trees.tree import DecisionTree


def prune(tree: DecisionTree, leaf_visits: ArrayLike) -> DecisionTree:
    """Return the tree without unvisited leaves, then without splits between equal leaves.

    It acts as the full tree on every observation that was visited. Source: thesis, appendix B.2.

    Args:
        tree: The tree.
        leaf_visits: [L] how often the validation episodes ended a decision in each leaf.

    Raises:
        InvalidTreeError: The visits are not those of this tree.
    """
    counts = np.asarray(leaf_visits)
    if counts.shape != (tree.num_leaves,):
        raise InvalidTreeError(
            f"visits must be one count for each of {tree.num_leaves} leaves, not of shape {counts.shape}"
        )
    if not (counts > 0).any():
        raise InvalidTreeError(
            "every episode ends in some leaf, but no leaf was visited: nothing was validated"
        )
    visited, split_visited = (counts > 0).tolist(), (tree.split_visits(counts > 0) > 0).tolist()
    kinds = _leaf_kinds(tree).tolist()
    left, right = tree.children_left.tolist(), tree.children_right.tolist()
    stands_for: dict[int, int] = {}
    # From the last split to the first, children come before their parents.
    for split in range(tree.num_decision_nodes - 1, -1, -1):
        is_visited = [
            visited[~child] if child < 0 else split_visited[child] for child in (left[split], right[split])
        ]
        left[split], right[split] = (stands_for.get(child, child) for child in (left[split], right[split]))
        of_left, of_right = left[split], right[split]
        equal = of_left < 0 and of_right < 0 and kinds[~of_left] == kinds[~of_right]
        if not is_visited[1] or equal:
            stands_for[split] = of_left
        elif not is_visited[0]:
            stands_for[split] = of_right
    arrays = tree.arrays._replace(
        children_left=np.array(left, np.int32), children_right=np.array(right, np.int32)
    )
    root = stands_for.get(0, 0) if tree.num_decision_nodes else ~0
    return DecisionTree.unchecked(
        selected(arrays, *depth_first(arrays.children_left, arrays.children_right, root))
    )


def simplify_tree(tree: DecisionTree, low: ArrayLike, high: ArrayLike) -> DecisionTree:
    """Return one tree without what no observation within the bounds can reach; see `simplify`."""
    if tree.has_actions:
        return simplify(Forest.stack([tree]), low, high).tree(0)
    # Leaves with values stand as actions meanwhile: one number for equal leaves.
    kinds = _leaf_kinds(tree)
    shape = tree.arrays._replace(action=kinds, value=np.zeros((len(kinds), 0), np.float32))
    simplified = simplify(Forest.stack([DecisionTree.unchecked(shape)]), low, high).tree(0)
    first_of_kind = {int(kind): leaf for leaf, kind in reversed(list(enumerate(kinds)))}
    leaves = [first_of_kind[int(kind)] for kind in simplified.action]
    with_leaves = selected(tree.arrays, [], leaves)
    return DecisionTree.unchecked(
        simplified.arrays._replace(
            action=with_leaves.action,
            value=with_leaves.value,
            leaf_term_start=with_leaves.leaf_term_start,
            leaf_feature=with_leaves.leaf_feature,
            leaf_weight=with_leaves.leaf_weight,
        )
    )


def _leaf_kinds(tree: DecisionTree) -> IntArray:
    """Return a number for each leaf, [L], equal for leaves that answer by the same action or the same numbers."""
    if tree.has_actions:
        return tree.action
    start = tree.leaf_term_start
    known: dict[bytes, int] = {}
    kinds = []
    for leaf in range(tree.num_leaves):
        terms = slice(start[leaf], start[leaf + 1])
        numbers = (tree.value[leaf], tree.leaf_feature[terms], tree.leaf_weight[terms])
        kinds.append(known.setdefault(b"".join(part.tobytes() for part in numbers), len(known)))
    return np.array(kinds, np.int32)


def simplify(forest: Forest, low: ArrayLike, high: ArrayLike) -> Forest:
    """Return the trees without what no observation can reach and without splits between equal subtrees.

    The observations are the float32 vectors with `low <= observation <= high`. On each of them a tree chooses
    what it chose before; a second pass changes nothing. Where splits compare one feature, every leaf that remains
    is chosen for some observation. A split on a sum goes only where the sum, by its terms one by one, is never on
    one side of the threshold.

    Args:
        forest: `P` individuals, some of them possibly without a tree.
        low: [D] float32, least observation, may be -inf.
        high: [D] float32, greatest observation, may be inf.

    Returns:
        The simplified trees; an individual without a tree stays without.

    Raises:
        InvalidTreeError: The bounds are out of order, or a tree uses a feature that they do not have.
    """
    # One memory layout is one compilation of the kernel.
    least, greatest = (np.array(bound, dtype=np.float32) for bound in (low, high))
    if least.ndim != 1 or least.shape != greatest.shape or not (least <= greatest).all():
        raise InvalidTreeError(f"bounds must be two vectors with low <= high, not {least} and {greatest}")
    used = int(forest.arrays.feature.max(initial=-1))
    if used >= len(least):
        raise InvalidTreeError(f"the bounds are those of {len(least)} features; a tree uses feature {used}")
    # The next float32 makes the upper bound exclusive. Behind the largest one comes inf, which serves too, as
    # every threshold is finite.
    with np.errstate(over="ignore"):
        ceiling = np.nextafter(greatest, np.float32(np.inf))
    return Forest(keep_what_is_reached(forest.arrays, Box(least, ceiling, greatest)))
