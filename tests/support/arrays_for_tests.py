"""A tree by its arrays, with actions in its leaves and with values."""

import numpy as np

from ge_torchrl.trees.tree import DecisionTree

AXIS_ALIGNED = {
    "feature": [2, 3],
    "threshold": [0.5, 0.25],
    "children_left": [1, ~0],
    "children_right": [~2, ~1],
    "action": [0, 1, 1],
}
TREE = DecisionTree.axis_aligned(**AXIS_ALIGNED)
ARRAYS = {name: array.tolist() for name, array in TREE.arrays._asdict().items()} | {
    "leaf_weight": np.zeros((0, 0))
}
VALUES = {
    **ARRAYS,
    "action": [],
    "value": [[0.5], [1.0], [2.0]],
    "leaf_term_start": [0, 0, 2, 2],
    "leaf_feature": [1, 0],
    "leaf_weight": [[1.0], [3.0]],
}
