"""A tree as its nodes, and what is left of it without one split."""

from hypothesis import given
from strategies import trees

from ge_torchrl.trees.nodes import Split, forest_of, nodes_of, without_one_split
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split


@given(trees())
def test_without_a_split_there_are_two_smaller_trees_for_each(tree):
    left = list(without_one_split(nodes_of(tree)))
    assert len(left) == 2 * tree.num_decision_nodes
    for nodes in left:
        smaller = forest_of([nodes]).tree(0)
        assert smaller.num_decision_nodes < tree.num_decision_nodes
        assert all(node in nodes_of(tree) for node in nodes if isinstance(node, Split))


def test_one_of_its_children_takes_its_place():
    tree = split(0, 1.0, split(1, 2.0, leaf(0), leaf(1)), leaf(2))
    left = [forest_of([nodes]).tree(0) for nodes in without_one_split(nodes_of(tree))]
    assert left == [
        split(1, 2.0, leaf(0), leaf(1)),
        leaf(2),
        split(0, 1.0, leaf(0), leaf(2)),
        split(0, 1.0, leaf(1), leaf(2)),
    ]
