import pytest
from hypothesis import given
from strategies import any_trees, trees

from ge_torchrl.trees.complexity import Complexity, complexity
from ge_torchrl.trees.tree import DecisionTree


def chain(n_decision_nodes):
    tree = DecisionTree.leaf(0)
    for _ in range(n_decision_nodes):
        tree = DecisionTree.split(0, 0.5, tree, DecisionTree.leaf(1))
    return tree


def test_a_lone_leaf_is_as_readable_as_can_be():
    assert complexity(DecisionTree.leaf(2)) == Complexity(1, 0, 0, 0)
    assert complexity(DecisionTree.leaf(2)).M == 0.0


@pytest.mark.parametrize(
    ("n_decision_nodes", "printed"),
    [(1, "17.8"), (2, "35.6"), (3, "53.4"), (4, "71.2"), (5, "89.0"), (6, "106.8")],
)
def test_metric_is_the_one_of_the_published_tables(n_decision_nodes, printed):
    assert str(complexity(chain(n_decision_nodes)).M) == printed


def test_counts_of_two_decision_nodes():
    assert complexity(chain(2)) == Complexity(
        size=11, operations=4, non_arithmetic_operations=4, non_arithmetic_compositions=4
    )


@pytest.mark.parametrize(
    ("counts", "metric"),
    [
        ((0, 0, 0, 0), -0.2),
        ((1, 0, 0, 0), 0.0),
        ((0, 1, 0, 0), 0.3),
        ((0, 0, 1, 0), 3.2),
        ((0, 0, 0, 1), 4.3),
    ],
)
def test_each_coefficient_of_equation_4(counts, metric):
    computed = Complexity(*counts).M
    assert computed == metric


@given(trees())
def test_every_decision_node_adds_the_same(tree):
    computed = complexity(tree).M
    assert computed == pytest.approx(17.8 * tree.num_decision_nodes)


def test_a_sum_adds_arithmetic():
    leaf = DecisionTree.leaf
    plain = complexity(DecisionTree.split(0, 0.5, leaf(0), leaf(1)))
    # 2 x - y + z: a product, an addition and a subtraction, each with an operator and what it brings.
    summed = complexity(DecisionTree.weighted_split([0, 1, 2], [2.0, -1.0, 1.0], 0.5, leaf(0), leaf(1)))
    assert summed == Complexity(plain.size + 6, plain.operations + 3, 2, 2)
    assert pytest.approx(17.8 + 6 * 0.2 + 3 * 0.5) == summed.M
    # -x - 2 y: a minus in front is an operation.
    negated = complexity(DecisionTree.weighted_split([0, 1], [-1.0, -2.0], 0.5, leaf(0), leaf(1)))
    assert negated == Complexity(plain.size + 5, plain.operations + 3, 2, 2)


def test_values_and_linear_leaves_are_counted():
    value = DecisionTree.value_leaf
    assert complexity(value([0.5])) == Complexity(1, 0, 0, 0)
    assert complexity(value([0.5, 1.0])) == Complexity(2, 0, 0, 0)
    # 0.5 + 3 x + y, and a constant: what has weight 0 is not there.
    assert complexity(value([0.5, 1.0], {0: [3.0, 0.0], 1: [1.0, 0.0]})) == Complexity(8, 3, 0, 0)
    # A constant of 0 is not there either, but alone.
    assert complexity(value([0.0, 0.0], {0: [3.0, 0.0]})) == Complexity(4, 1, 0, 0)
    assert complexity(value([0.0], {0: [-1.0], 1: [-1.0]})) == Complexity(4, 2, 0, 0)
    # -2.5 - x: a subtraction.
    assert complexity(value([-2.5], {0: [-1.0]})) == Complexity(3, 1, 0, 0)


@given(any_trees())
def test_counts_are_whole_numbers_and_no_tree_is_easier_than_a_lone_action(tree):
    counts = complexity(tree)
    assert all(type(getattr(counts, name)) is int for name in ("size", "operations"))
    assert 17.8 * tree.num_decision_nodes - 1e-9 <= counts.M
