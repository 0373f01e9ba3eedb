"""Mirrors of well-known environments, and dense starts in them."""

from __future__ import annotations

import numpy as np

from ge_torchrl.refiners.mirror import Mirror
from ge_torchrl.search.shapes import Shapes
from ge_torchrl.trees.controller import Names

_LANDER = ("x", "y", "x_dot", "y_dot", "theta", "theta_dot", "left_leg", "right_leg")
_LANDER_MIRROR = {"negate": ["x", "x_dot", "theta", "theta_dot"], "swap": [["left_leg", "right_leg"]]}
_BOUNDS = ((-1.0, 1.0),)

NAMES = {
    "lander": Names("Lander-v0", _LANDER, 8 * ("",), ("none", "left", "main", "right")),
    "cart": Names("Cart-v0", ("x", "x_dot", "theta", "theta_dot"), 4 * ("",), ("left", "right")),
    "pendulum": Names(
        "Pendulum-v0", ("cos", "sin", "omega"), 3 * ("",), ("torque",), action_bounds=((-2.0, 2.0),)
    ),
    "lander with two engines": Names(
        "Lander-v1", _LANDER, 8 * ("",), ("main", "side"), action_bounds=2 * _BOUNDS
    ),
}
MIRRORS = {
    "lander": Mirror.declared({**_LANDER_MIRROR, "actions": {"left": "right"}}, NAMES["lander"]),
    "cart": Mirror.declared(
        {"negate": ["x", "x_dot", "theta", "theta_dot"], "actions": {"left": "right"}}, NAMES["cart"]
    ),
    "pendulum": Mirror.declared(
        {"negate": ["sin", "omega"], "negate_actions": ["torque"]}, NAMES["pendulum"]
    ),
    "lander with two engines": Mirror.declared(
        {**_LANDER_MIRROR, "negate_actions": ["side"]}, NAMES["lander with two engines"]
    ),
}


def shapes_of(name, rng, mirrored=True, oblique=True, linear=True):
    """Return what draws dense starts of an environment whose features spread anyhow."""
    names, mirror = NAMES[name], MIRRORS[name]
    spread = rng.uniform(0.1, 2.0, len(names.features))
    half_range = [(high - low) / 2 for low, high in names.action_bounds]
    return Shapes(
        spread=np.maximum(spread, spread[mirror.feature]),
        n_actions=len(names.actions),
        half_range=np.array(half_range),
        mirror=mirror if mirrored else None,
        oblique=oblique,
        linear=linear,
    )
