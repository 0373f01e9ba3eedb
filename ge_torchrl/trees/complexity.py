"""How hard a tree is to read: the metric M of the literature on interpretable reinforcement learning."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ge_torchrl.trees.tree import DecisionTree, FloatArray


@dataclass(frozen=True)
class Complexity:
    """The four counts of a model and the metric made of them; a higher `M` is harder to read.

    Attributes:
        size: `l`, operations, variables and constants together.
        operations: `n_o`, operations.
        non_arithmetic_operations: `n_nao`, operations other than arithmetic.
        non_arithmetic_compositions: `n_naoc`, consecutive compositions of such operations.
    """

    size: int
    operations: int
    non_arithmetic_operations: int
    non_arithmetic_compositions: int

    @property
    def M(self) -> float:  # noqa: N802, the literature's name
        """The metric `M = -0.2 + 0.2 l + 0.5 n_o + 3.4 n_nao + 4.5 n_naoc`.

        Source: the thesis "Backpropagation-based reinforcement learning for decision trees", section 2.5,
        Eq. 4. The coefficients are those of Virgolin et al., "Learning a formula of interpretability to learn
        interpretable formulas" (2020).
        """
        metric = (
            -0.2
            + 0.2 * self.size
            + 0.5 * self.operations
            + 3.4 * self.non_arithmetic_operations
            + 4.5 * self.non_arithmetic_compositions
        )
        # The coefficients have one decimal; what stands behind it is the error of binary arithmetic.
        return round(metric, 10)


def complexity(tree: DecisionTree) -> Complexity:
    """Return the counts of a tree; a split on one feature adds 17.8 to the metric, a lone action has 0.

    A lone leaf is one constant. A split adds five terms (if, <, the feature, the threshold and one more leaf) and two
    operations (if and <), both of them non-arithmetic and each composed with another. What a split sums and what a leaf
    computes adds arithmetic, as its text shows it: `render_text` leaves out a constant of 0 and weights of 0.

    Args:
        tree: The tree, pruned first where its full form should not count.

    Returns:
        Its four counts.
    """
    n = tree.num_decision_nodes
    sums = [
        _Arithmetic.of(tree.weight[first:end]) for first, end in itertools.pairwise(tree.term_start.tolist())
    ]
    for leaf, (first, end) in enumerate(itertools.pairwise(tree.leaf_term_start.tolist())):
        weights = tree.leaf_weight[first:end]
        columns = zip(tree.value[leaf], weights.T, strict=True)
        sums += [_Arithmetic.of(of_column[of_column != 0], constant) for constant, of_column in columns]
    # Each split has an if, a < and a threshold of its own.
    others = 3 * n + (tree.num_leaves if tree.has_actions else 0)
    return Complexity(
        size=others + sum(of_sum.operands + of_sum.operations for of_sum in sums),
        operations=2 * n + sum(of_sum.operations for of_sum in sums),
        non_arithmetic_operations=2 * n,
        non_arithmetic_compositions=2 * n,
    )


class _Arithmetic(NamedTuple):
    """Variables and constants of a sum, and what is done with them."""

    operands: int
    operations: int

    @classmethod
    def of(cls, weights: FloatArray, constant: float = 0.0) -> _Arithmetic:
        n_summands = len(weights) + int(constant != 0 or len(weights) == 0)
        products = int(np.count_nonzero(np.abs(weights) != 1))
        # A minus in front of all is an operation; between summands it stands for the plus.
        negation = int(constant == 0 and len(weights) > 0 and weights[0] == -1)
        return cls(n_summands + products, n_summands - 1 + products + negation)
