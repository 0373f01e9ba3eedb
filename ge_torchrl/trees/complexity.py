"""How hard a tree is to read: the metric M of the literature on interpretable reinforcement learning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ge_torchrl.trees.tree import DecisionTree


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
    computes adds arithmetic: every further feature an addition, every weight other than 1 a product. A leaf has one
    constant for each value.

    Args:
        tree: The tree, pruned first where its full form should not count.

    Returns:
        Its four counts.
    """
    n = tree.num_decision_nodes
    additions = len(tree.feature) - n + np.count_nonzero(tree.leaf_weight)
    products = np.count_nonzero(tree.weight != 1) + np.count_nonzero(
        (tree.leaf_weight != 0) & (tree.leaf_weight != 1)
    )
    constants = tree.value.size if not tree.has_actions else tree.num_leaves
    # An addition brings a feature, a product a weight, and each its own operator.
    arithmetic = int(additions + products)
    return Complexity(
        size=constants + 4 * n + 2 * arithmetic,
        operations=2 * n + arithmetic,
        non_arithmetic_operations=2 * n,
        non_arithmetic_compositions=2 * n,
    )
