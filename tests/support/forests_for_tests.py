"""A forest of one individual without a tree."""

import numpy as np

from ge_torchrl.trees.forest import Forest

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
