"""The trees whose rollouts tell how fast a kernel is."""

from __future__ import annotations

import numpy as np

from ge_torchrl.environments.kernels.dynamics import Dynamics
from ge_torchrl.environments.kernels.lanes import LANES, OBSERVATION
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

_TREES = 200


def probing_trees(spec: EnvironmentSpec, dynamics: Dynamics) -> Forest:
    """Return small random trees whose thresholds lie among what first observations give."""
    rng = np.random.default_rng(0)
    first = OBSERVATION // LANES
    seen = dynamics.starts(np.arange(_TREES))[:, first : first + spec.n_features]

    def grow(depth: int) -> DecisionTree:
        if depth == 0 and spec.is_continuous:
            constants, *slopes = rng.normal(size=(1 + spec.n_features, spec.n_actions)).tolist()
            return DecisionTree.value_leaf(constants, dict(enumerate(slopes)))
        if depth == 0:
            return DecisionTree.leaf(int(rng.integers(spec.n_actions)))
        feature = int(rng.integers(spec.n_features))
        threshold = float(rng.choice(seen[:, feature]))
        return DecisionTree.split(feature, threshold, grow(depth - 1), grow(depth - 1))

    return Forest.stack([grow(2) for _ in range(_TREES)])
