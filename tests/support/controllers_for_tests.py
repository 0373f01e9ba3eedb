"""Random controllers of every kind, for what has to hold of each of them."""

import numpy as np
from strategies import COMMON_THRESHOLDS

from ge_torchrl.trees.controller import Controller, Names
from ge_torchrl.trees.tree import DecisionTree

KINDS = tuple(
    (splits, leaves) for splits in ("axis", "oblique", "mixed") for leaves in ("action", "constant", "linear")
)
_FEATURES = ("x", "x_dot", "θ", "2nd angle", "lambda", "left", "Left", "A/B", "")
_ACTIONS = ("force", "μ-torque", "return", "x", "LIMIT")


def random_controllers(n, seed, kinds=KINDS):
    """Return `n` controllers, the kinds in turn, of 1 to 9 features and 1 to 5 actions or values."""
    rng = np.random.default_rng(seed)
    return [random_controller(*kinds[place % len(kinds)], rng) for place in range(n)]


def random_controller(splits, leaves, rng):
    """Return a controller with splits and leaves of a kind, with odd names and bounds of all sorts."""
    n_features, n_actions = (int(rng.integers(1, most + 1)) for most in (9, 5))

    def number():
        if rng.random() < 0.2:
            return float(rng.choice(COMMON_THRESHOLDS))
        # Numbers of few digits, as rounding leaves them, and of all.
        drawn = rng.normal() * 10.0 ** rng.integers(-3, 3)
        return float(np.round(drawn, 2) if rng.random() < 0.4 else drawn)

    def leaf():
        if leaves == "action":
            return DecisionTree.leaf(int(rng.integers(n_actions)))
        n_terms = int(rng.integers(0, 4)) if leaves == "linear" else 0
        used = rng.permutation(n_features)[:n_terms]
        terms = {int(f): [number() * bool(rng.random() < 0.8) for _ in range(n_actions)] for f in used}
        return DecisionTree.value_leaf([number() for _ in range(n_actions)], terms)

    def grow(depth):
        if depth == 0 or rng.random() < 0.15:
            return leaf()
        is_sum = splits == "oblique" or (splits == "mixed" and rng.random() < 0.5)
        n_terms = int(rng.integers(1, 5)) if is_sum else 1
        features = [int(f) for f in rng.integers(n_features, size=n_terms)]
        weights = [float(rng.choice([number(), 1.0, -1.0])) if is_sum else 1.0 for _ in features]
        return DecisionTree.weighted_split(features, weights, number(), grow(depth - 1), grow(depth - 1))

    tree = grow(int(rng.integers(0, 6)))
    lows = rng.choice([-np.inf, -1.0, -0.1, 0.0], n_actions)
    highs = rng.choice([np.inf, 1.0, 0.3, 0.0], n_actions)
    names = Names(
        id="Random-v0",
        features=_FEATURES[:n_features],
        units=tuple(rng.choice(["", "m/s", "°"], n_features).tolist()),
        actions=_ACTIONS[:n_actions],
        action_bounds=()
        if leaves == "action" or rng.random() < 0.2
        else tuple(zip(lows.tolist(), highs.tolist(), strict=True)),
    )
    return Controller(tree, names)
