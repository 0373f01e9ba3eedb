"""Smaller trees that act the same: on what a validation visited, or on all that the bounds allow."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.arrays import ForestArrays, IntArray, LeafArrays, TreeArrays, depth_first, selected
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.reachable import Box, keep_what_is_reached
from ge_torchrl.trees.stacking import leaves_taken
from ge_torchrl.trees.tidying import tidied
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
    kinds = _kinds_of_leaves(tree.arrays).tolist()
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


def simplify(forest: Forest, low: ArrayLike, high: ArrayLike) -> Forest:
    """Return the trees without what no observation can reach and without splits between equal subtrees.

    The observations are the float32 vectors with `low <= observation <= high`, finite ones where there are weights.
    On each of them a tree answers what it answered before; a second pass changes nothing. Where splits compare one
    feature, every leaf that remains is chosen for some observation. A split on a sum goes only where the sum, by its
    terms one by one, is never on one side of the threshold, or where the path has compared the same sum before.
    Sums lose what they do not need, as `tidied` says.

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
    box = Box(least, ceiling, greatest)
    arrays = forest.arrays
    if not forest.is_axis_aligned or len(arrays.leaf_feature) > 0:
        arrays = tidied(arrays)
    if forest.has_actions:
        return Forest(keep_what_is_reached(arrays, box))
    # Leaves with values stand as actions meanwhile: one number for equal leaves.
    as_actions = LeafArrays.of_actions(_kinds_of_leaves(arrays))
    kept = keep_what_is_reached(arrays._replace(**as_actions._asdict()), box)
    return Forest(kept._replace(**leaves_taken(arrays, kept.action.astype(np.int64))._asdict()))


def _kinds_of_leaves(arrays: TreeArrays | ForestArrays) -> IntArray:
    """Return the first leaf that answers as each leaf does, [L]: by the same action or by the same numbers."""
    start = arrays.leaf_term_start.tolist()
    first: dict[int | bytes, int] = {}
    answers: list[int | bytes]
    if arrays.value.shape[1] == 0:
        answers = arrays.action.tolist()
    else:
        answers = [
            arrays.value[leaf].tobytes()
            + arrays.leaf_feature[start[leaf] : start[leaf + 1]].tobytes()
            + arrays.leaf_weight[start[leaf] : start[leaf + 1]].tobytes()
            for leaf in range(len(arrays.value))
        ]
    return np.array([first.setdefault(answer, leaf) for leaf, answer in enumerate(answers)], np.int32)
