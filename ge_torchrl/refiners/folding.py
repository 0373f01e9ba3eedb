"""Trees of a mirror, folded: half of a tree that is its own mirror image, from which the whole follows.

The half of a tree is a tree too, so it is edited as others are. Read from its root, a test that is its own image
stays as it is. The first test of a feature `f` that changes its sign, `f < c`, asks how far `f` lies from 0: up to `c`
the half goes on to the left, and beyond it the right subtree answers, mirrored where `f` is negative. With `c = 0`
nothing lies between, and the left child means nothing. A test of two features that change places asks either of them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.refiners.mirror import Mirror
from ge_torchrl.trees.arrays import FloatArray
from ge_torchrl.trees.nodes import Leaf, Nodes, Split, end_of, nodes_of
from ge_torchrl.trees.tree import DecisionTree

# Thresholds that snapping left so near to each other are one.
_ALIKE: Final = 1e-5


def can_fold(tree: DecisionTree) -> bool:
    """Tell whether a tree is of the kind that is folded: its splits test one feature, its leaves hold actions."""
    return tree.is_axis_aligned and tree.has_actions


def half_of(tree: DecisionTree, mirror: Mirror) -> Nodes | None:
    """Return half of a tree that is its own image as it is written; None for any other tree.

    Args:
        tree: The tree.
        mirror: Of the environment.
    """
    return _half(nodes_of(tree), mirror) if can_fold(tree) else None


def whole_of(half: Nodes, mirror: Mirror) -> Nodes | None:
    """Return the tree whose half it is; None where the half answers what is not its own image, before any fold.

    Args:
        half: The half.
        mirror: Of the environment.
    """
    first = half[0]
    if not isinstance(first, Split):
        return list(half) if mirror.action[_action(first)] == first else None
    left, right = _children(half)
    feature, threshold = first.feature[0], first.threshold
    if mirror.changes_sign(feature):
        return _whole_of_fold(feature, threshold, left, right, mirror)
    wholes = whole_of(left, mirror), whole_of(right, mirror)
    if wholes[0] is None or wholes[1] is None:
        return None
    if mirror.feature[feature] != feature:
        other = first._replace(feature=(int(mirror.feature[feature]),))
        return [first, other, *wholes[0], *wholes[1], *wholes[1]]
    return [first, *wholes[0], *wholes[1]]


def _whole_of_fold(feature: int, threshold: float, left: Nodes, right: Nodes, mirror: Mirror) -> Nodes | None:
    if threshold == 0:
        return [_test(feature, 0.0), *_image(right, mirror), *right]
    beyond, between = (right, left) if threshold > 0 else (_image(left, mirror), right)
    middle = whole_of(between, mirror)
    if middle is None:
        return None
    reach = abs(threshold)
    return [_test(feature, -reach), *_image(beyond, mirror), _test(feature, reach), *middle, *beyond]


def tied_leaves(half: Nodes, mirror: Mirror) -> NDArray[np.int64]:
    """Return for each leaf of the whole which leaf of the half it comes from, [L]; a leaf and its image have one.

    Args:
        half: The half of a tree that is its own image.
        mirror: Of the environment.
    """
    is_leaf = [not isinstance(node, Split) for node in half]
    numbers = np.cumsum(is_leaf).tolist()
    numbered = [numbers[i] if is_leaf[i] else node for i, node in enumerate(half)]
    # Where every answer is its own image, the number of a leaf goes with it.
    whole = whole_of(numbered, replace(mirror, action=np.arange(numbers[-1] + 1)))
    if whole is None:
        raise ValueError("a half of leaves that are their own images has a whole")
    return np.array([node for node in whole if not isinstance(node, Split)], np.int64)


def numbered(half: Nodes, mirror: Mirror) -> Nodes:
    """Return a half with a number in place of each threshold, from 1 on and of its sign; a fold at 0 stays there.

    Args:
        half: The half of a tree that is its own image.
        mirror: Of the environment.
    """
    nodes: Nodes = []
    is_beyond = [False]
    for number, node in enumerate(half, 1):
        beyond = is_beyond.pop()
        if not isinstance(node, Split):
            nodes.append(node)
            continue
        threshold, is_fold = node.threshold, not beyond and mirror.changes_sign(node.feature[0])
        is_beyond += [beyond or (is_fold and threshold >= 0), beyond or (is_fold and threshold < 0)]
        if threshold != 0 or not is_fold:
            nodes.append(node._replace(threshold=float(-number if threshold < 0 else number)))
        else:
            nodes.append(node)
    return nodes


def fold_at(feature: int, beyond: Nodes, mirror: Mirror) -> Nodes:
    """Return the half of a tree that answers with `beyond` where a feature is 0 or more, and with its image elsewhere.

    Args:
        feature: It changes its sign in the mirror.
        beyond: An ordinary tree.
        mirror: Of the environment.
    """
    # Nobody reads the left child.
    return [_test(feature, 0.0), _own_image(mirror), *beyond]


def fold_observations(half: Nodes, observations: FloatArray, mirror: Mirror) -> FloatArray:
    """Return observations [T, D] as the half sees them: each itself, or its mirror image.

    Args:
        half: The half.
        observations: What the whole tree acted on.
        mirror: Of the environment.
    """
    seen = np.array(observations, np.float32)
    _fold(half, seen, np.arange(len(seen)), mirror)
    return seen


def _fold(half: Nodes, seen: FloatArray, rows: NDArray[np.int64], mirror: Mirror) -> None:
    first = half[0]
    if not isinstance(first, Split) or len(rows) == 0:
        return
    feature, threshold = first.feature[0], first.threshold
    (left, right), is_odd = _children(half), mirror.changes_sign(feature)
    turned = np.zeros(len(rows), np.bool_)
    if is_odd:
        turned = seen[rows, feature] < 0 if threshold >= 0 else seen[rows, feature] > 0
    elif (other := int(mirror.feature[feature])) != feature:
        turned = (seen[rows, feature] < threshold) & (seen[rows, other] >= threshold)
    seen[rows[turned]] = mirror.observations(seen[rows[turned]])
    goes_left = seen[rows, feature] < threshold
    # Beyond a fold the half is an ordinary tree.
    if not is_odd or threshold > 0:
        _fold(left, seen, rows[goes_left], mirror)
    if not is_odd or threshold < 0:
        _fold(right, seen, rows[~goes_left], mirror)


def _half(nodes: Nodes, mirror: Mirror) -> Nodes | None:
    first = nodes[0]
    if not isinstance(first, Split):
        return nodes if mirror.action[_action(first)] == first else None
    left, right = _children(nodes)
    feature, threshold = first.feature[0], first.threshold
    if mirror.changes_sign(feature):
        return _half_of_fold(feature, threshold, left, right, mirror)
    if mirror.feature[feature] != feature:
        test = first._replace(feature=(int(mirror.feature[feature]),))
        if not _is_test(left[0], test):
            return None
        left, also = _children(left)
        if not _alike(also, right):
            return None
    halves = _half(left, mirror), _half(right, mirror)
    return None if halves[0] is None or halves[1] is None else [first, *halves[0], *halves[1]]


def _half_of_fold(feature: int, threshold: float, left: Nodes, right: Nodes, mirror: Mirror) -> Nodes | None:
    if abs(threshold) <= _ALIKE:
        if not _alike(_image(left, mirror), right):
            return None
        return fold_at(feature, right, mirror)
    if threshold > 0 or not _is_test(right[0], _test(feature, -threshold)):
        return None
    between, beyond = _children(right)
    middle = _half(between, mirror)
    if middle is None or not _alike(_image(left, mirror), beyond):
        return None
    return [_test(feature, -threshold), *middle, *beyond]


def _image(nodes: Nodes, mirror: Mirror) -> Nodes:
    """Return what a subtree is in the mirror, up to what is exactly at a threshold."""
    first = nodes[0]
    if not isinstance(first, Split):
        return [int(mirror.action[_action(first)])]
    left, right = (_image(child, mirror) for child in _children(nodes))
    feature = first.feature[0]
    if mirror.sign[feature] < 0:
        return [_test(int(mirror.feature[feature]), -first.threshold), *right, *left]
    return [_test(int(mirror.feature[feature]), first.threshold), *left, *right]


def _alike(nodes: Nodes, others: Nodes) -> bool:
    return len(nodes) == len(others) and all(
        _is_test(one, other) if isinstance(other, Split) else one == other
        for one, other in zip(nodes, others, strict=True)
    )


def _is_test(node: Split | Leaf, test: Split) -> bool:
    return (
        isinstance(node, Split)
        and node.feature == test.feature
        and abs(node.threshold - test.threshold) <= _ALIKE * max(1.0, abs(test.threshold))
    )


def _children(nodes: Nodes) -> tuple[Nodes, Nodes]:
    middle = end_of(nodes, 1)
    return nodes[1:middle], nodes[middle:]


def _test(feature: int, threshold: float) -> Split:
    # Adding zero makes -0.0 into 0.0, as in a tree.
    return Split((feature,), (1.0,), threshold + 0.0)


def _action(leaf: Leaf) -> int:
    if not isinstance(leaf, int):
        raise TypeError("a tree that is folded answers with actions")
    return leaf


def _own_image(mirror: Mirror) -> int:
    """Return an action that is its own image, or the first one."""
    return int(np.argmax(mirror.action == np.arange(len(mirror.action))))
