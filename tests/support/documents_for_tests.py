"""A document and its text."""

from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.labels import TreeLabels
from ge_torchrl.trees.serialization import TreeDocument

leaf, split = DecisionTree.leaf, DecisionTree.split

LABELS = TreeLabels(
    environment="CartPole-v1",
    features=("x", "x_dot", "theta", "theta_dot"),
    units=("m", "m/s", "rad", "rad/s"),
    actions=("left", "right"),
)
DOCUMENT = TreeDocument(
    tree=split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1)),
    labels=LABELS,
    provenance={"seed": 3, "returns": {"test": 499.8, "episodes": [1, 2]}},
)
TEXT = """\
{
  "format": "ge_torchrl.tree/1",
  "environment": {
    "id": "CartPole-v1",
    "features": ["x", "x_dot", "theta", "theta_dot"],
    "units": ["m", "m/s", "rad", "rad/s"],
    "actions": ["left", "right"]
  },
  "feature": [2, 3, -1, -1, -1],
  "threshold": [0.0154, 0.229, 0.0, 0.0, 0.0],
  "children_left": [1, 2, -1, -1, -1],
  "children_right": [4, 3, -1, -1, -1],
  "action": [-1, -1, 0, 1, 1],
  "provenance": {
    "returns": {"episodes": [1, 2], "test": 499.8},
    "seed": 3
  }
}
"""
