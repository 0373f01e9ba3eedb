"""Forests of one individual: one without a tree, and one to simplify."""

import numpy as np

from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.simplify import simplify

_NO_INTS = np.zeros(0, np.int32)
NO_TREE = Forest.axis_aligned(
    split_start=np.zeros(2, np.int64),
    leaf_start=np.zeros(2, np.int64),
    feature=_NO_INTS,
    threshold=np.zeros(0, np.float32),
    children_left=_NO_INTS,
    children_right=_NO_INTS,
    action=_NO_INTS,
)


def simplify_one(tree, low, high):
    """Return one tree, simplified."""
    return simplify(Forest.stack([tree]), low, high).tree(0)
