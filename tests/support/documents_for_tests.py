"""A controller and its text, in the present format and in the one before it."""

from dataclasses import replace

import numpy as np

from ge_torchrl.trees.controller import Controller, Names
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split

NAMES = Names(
    id="CartPole-v1",
    features=("x", "x_dot", "theta", "theta_dot"),
    units=("m", "m/s", "rad", "rad/s"),
    actions=("left", "right"),
)
CONTROLLER = Controller(
    tree=split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1)),
    names=NAMES,
    provenance={"seed": 3, "returns": {"test": 499.8, "episodes": [1, 2]}},
)
TEXT = """\
{
  "format": "ge_torchrl.tree/2",
  "environment": {
    "id": "CartPole-v1",
    "kwargs": {},
    "wrappers": [],
    "max_episode_steps": null,
    "features": ["x", "x_dot", "theta", "theta_dot"],
    "units": ["m", "m/s", "rad", "rad/s"],
    "actions": ["left", "right"]
  },
  "splits": [
    {"terms": [{"feature": 2, "weight": 1.0}], "threshold": 0.0154, "left": 1, "right": -3},
    {"terms": [{"feature": 3, "weight": 1.0}], "threshold": 0.229, "left": -1, "right": -2}
  ],
  "leaves": [
    {"action": 0},
    {"action": 1},
    {"action": 1}
  ],
  "provenance": {
    "returns": {"episodes": [1, 2], "test": 499.8},
    "seed": 3
  }
}
"""
TEXT_1 = """\
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
WIDE = Controller(
    tree=DecisionTree.weighted_split(
        [0, 2],
        [2.0, -0.5],
        0.25,
        DecisionTree.value_leaf([0.5, 1.0], {3: [1.0, 0.0], 0: [-2.0, 0.1]}),
        DecisionTree.value_leaf([0.0, -1.0]),
    ),
    names=Names(
        id="Somewhere-v0",
        features=("x", "x_dot", "theta", "theta_dot"),
        units=("m", "m/s", "m", "rad/s"),
        actions=("force", "torque"),
        kwargs={"wind": 1.5, "map": {"b": 1, "a": [2]}},
        wrappers=("gymnasium.wrappers:FlattenObservation",),
        max_episode_steps=200,
        action_bounds=((-1.0, 1.0), (-0.1, np.inf)),
    ),
)
"""A controller with everything that the type has."""


def names_for(tree: DecisionTree) -> Names:
    """Return names that a tree on 4 features fits: of 3 actions, or of as many values as its leaves hold."""
    actions, bounds = ("force", "torque", "brake"), (*WIDE.names.action_bounds, (-np.inf, np.inf))
    if tree.has_actions:
        return replace(WIDE.names, actions=actions, action_bounds=())
    n_values = tree.value.shape[1]
    return replace(WIDE.names, actions=actions[:n_values], action_bounds=bounds[:n_values])


WIDE_TEXT = """\
{
  "format": "ge_torchrl.tree/2",
  "environment": {
    "id": "Somewhere-v0",
    "kwargs": {"map": {"a": [2], "b": 1}, "wind": 1.5},
    "wrappers": ["gymnasium.wrappers:FlattenObservation"],
    "max_episode_steps": 200,
    "features": ["x", "x_dot", "theta", "theta_dot"],
    "units": ["m", "m/s", "m", "rad/s"],
    "actions": ["force", "torque"],
    "action_bounds": [[-1.0, 1.0], [-0.1, null]]
  },
  "splits": [
    {"terms": [{"feature": 0, "weight": 2.0}, {"feature": 2, "weight": -0.5}], "threshold": 0.25, "left": -1, "right": -2}
  ],
  "leaves": [
    {"value": [0.5, 1.0], "linear": [{"feature": 3, "weights": [1.0, 0.0]}, {"feature": 0, "weights": [-2.0, 0.1]}]},
    {"value": [0.0, -1.0], "linear": []}
  ],
  "provenance": {}
}
"""  # noqa: E501


def places(value, path=()):
    """Yield the path to every value within a JSON value."""
    yield path
    entries = (
        value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    )
    for key, entry in entries:
        yield from places(entry, (*path, key))


def replaced(value, path, new):
    if not path:
        return new
    copy = value.copy()
    copy[path[0]] = replaced(value[path[0]], path[1:], new) if path[1:] else new
    return copy
