"""Edits of trees: what leads from a tree to its neighbours, which have a split or a term more or less, or another one.

Mutation of codons edits trees too, but behind the codon that changed it mostly gives another tree ("ripple"); an edit
leaves everything else as it is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.arrays import FloatArray
from ge_torchrl.trees.edit_kinds import EDITS, Edit
from ge_torchrl.trees.nodes import Nodes, Split, Values, end_of, forest_of, nodes_of
from ge_torchrl.trees.rows import starts
from ge_torchrl.trees.tree import DecisionTree

__all__ = ["Neighbourhood", "Nodes", "Split", "Values", "forest_of"]

# Growing is the likeliest, since the other edits keep trees small. Chosen on MountainCar and Acrobot.
_PROBABILITIES = {"grow": 0.4, "test_anew": 0.3, "drop": 0.1, "relabel": 0.2}
# Beside these, for sums and for linear leaves: a tree mostly lacks a term before it has one too many.
_OF_SUMS = {"add_term": 0.4, "drop_term": 0.2}
_OF_LINEAR_LEAVES = {"add_leaf_term": 0.4, "drop_leaf_term": 0.2}
_SECOND_EDIT_PROBABILITY = 0.3


class Neighbourhood:
    """A tree and the states that it saw, from which the tests of its neighbours come.

    Args:
        tree: The tree.
        observed: [T, D] float32, at least one observation that it acted on. What is infinite counts as the largest
            float32, what is NaN as 0, since a threshold is finite.
        oblique: Whether neighbours may compare sums of features; if not, a split compares one.
        linear: Whether leaves with values may add linear terms to their constants.
        action_bounds: Where leaves hold values, (low, high) of each of them, as in `Names.action_bounds`, from which
            constants are drawn; empty for none.

    Raises:
        InvalidTreeError: Nothing was observed, or there are not as many bounds as a leaf holds values.
    """

    def __init__(
        self,
        tree: DecisionTree,
        observed: FloatArray,
        *,
        oblique: bool = False,
        linear: bool = False,
        action_bounds: Sequence[tuple[float, float]] = (),
    ) -> None:
        n_values = tree.value.shape[1]
        if len(observed) == 0 or len(action_bounds) not in (0, n_values):
            raise InvalidTreeError(
                "neighbours are those of a tree that saw at least one state, with bounds for each of the values of "
                f"its leaves; this one saw {len(observed)} states, and there are {len(action_bounds)} bounds for "
                f"{n_values} values"
            )
        leaf = tree.leaf_of(observed)
        order = np.argsort(leaf, kind="stable")
        self.tree = tree
        self._nodes = nodes_of(tree)
        # By leaf, so that what came to a subtree is a run of rows.
        self._observed = np.nan_to_num(np.asarray(observed, np.float32))[order]
        self._leaf_start = starts(np.bincount(leaf, minlength=tree.num_leaves)).tolist()
        self._bounds = tuple(action_bounds) or ((-np.inf, np.inf),) * n_values
        of_leaves = _OF_LINEAR_LEAVES if linear and n_values > 0 else {}
        self._kinds = {**_PROBABILITIES, **(_OF_SUMS if oblique else {}), **of_leaves}
        # A lone leaf has no split to edit, and another action alone is no neighbour.
        relabel = {"relabel": _PROBABILITIES["relabel"]} if n_values > 0 else {}
        self._kinds_of_a_leaf = {"grow": _PROBABILITIES["grow"], **relabel, **of_leaves}

    def draw(
        self, features: Sequence[int] | NDArray[np.int64], n_actions: int, rng: np.random.Generator
    ) -> Nodes:
        """Return a tree one edit away, sometimes two; `forest_of` makes a forest of what was drawn.

        Args:
            features: Features that new splits and new terms may take.
            n_actions: Number of actions, A.
            rng: Source of randomness.
        """
        nodes = self._nodes
        for number in range(1 + (rng.random() < _SECOND_EDIT_PROBABILITY)):
            # Only in the tree itself is it known which states come to a node.
            leaf_start = self._leaf_start if number == 0 else None
            kinds = self._kinds_of_a_leaf if len(nodes) == 1 else self._kinds
            kind = _kind(kinds, rng) if len(kinds) > 1 else "grow"
            edit = Edit(nodes, self._observed, leaf_start, features, n_actions, rng, self._bounds)
            nodes = EDITS[kind](edit)
        return nodes

    def crossed_with(self, other: Neighbourhood, rng: np.random.Generator) -> Nodes:
        """Return the tree with one of its subtrees replaced by a subtree of another tree, both at random.

        Args:
            other: The other tree; it may be this one.
            rng: Source of randomness.

        Source:
            J. Koza, "Genetic Programming" (1992), subtree crossover.
        """
        at, of_other = (int(rng.random() * len(nodes)) for nodes in (self._nodes, other._nodes))
        subtree = other._nodes[of_other : end_of(other._nodes, of_other)]
        return [*self._nodes[:at], *subtree, *self._nodes[end_of(self._nodes, at) :]]


def _kind(kinds: dict[str, float], rng: np.random.Generator) -> str:
    """Return a kind of edit, each as often as its share says."""
    # What the first four draw must not depend on how their sum is rounded.
    drawn = rng.random() * (sum(kinds.values()) if kinds.keys() != _PROBABILITIES.keys() else 1.0)
    for kind, probability in kinds.items():
        drawn -= probability
        if drawn < 0:
            return kind
    return "relabel"
