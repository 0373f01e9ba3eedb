import numpy as np
import pytest

from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.search.fitness import Measurement
from ge_torchrl.search.settling import settle
from ge_torchrl.trees.decision_tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
GRAMMAR = read_grammar(
    """
    <if>     ::= if <test> then <action> else <action>
    <test>   ::= lt(a, [-1, 1] step 0.1) | lt(b, [0, 100] step 10)
    <action> ::= left | right | <if>
    """,
    ("a", "b", "c"),
    ("left", "right"),
)


class Measures:
    """Gives a fitness that the thresholds alone decide, and counts the batches and trees."""

    def __init__(self, fitness_of):
        self.fitness_of, self.batches = fitness_of, []

    def __call__(self, forest):
        trees = [forest.tree(i) for i in range(len(forest))]
        self.batches.append(len(trees))
        fitness = np.array([self.fitness_of(*tree.threshold[~tree.is_leaf]) for tree in trees])
        return Measurement(fitness, 10 * len(trees))


def tree_of(a, b):
    return split(0, a, leaf(0), split(1, b, leaf(1), leaf(0)))


def thresholds(tree):
    return tree.threshold[~tree.is_leaf].tolist()


def test_thresholds_move_one_by_one_to_the_best_constants():
    # What is best for one threshold depends on the other, so that several rounds are needed.
    measures = Measures(lambda a, b: -((10 * a - b / 10) ** 2) / 2 - (b / 10 - 3) ** 2)
    settled, env_steps = settle(tree_of(0.0, 50.0), GRAMMAR, measures)
    assert thresholds(settled) == pytest.approx([0.3, 30.0])
    assert settled.structure == tree_of(0.0, 50.0).structure
    # Six moves of each threshold, but for those beyond the last constant; every tree took ten steps.
    assert measures.batches[:2] == [1, 12]
    assert env_steps == 10 * sum(measures.batches)


def test_a_tree_that_no_move_makes_better_stays():
    before = tree_of(0.5, 50.0)
    settled, _ = settle(before, GRAMMAR, Measures(lambda _a, _b: 7.0))
    assert settled == before


def test_moves_end_where_the_constants_do():
    measures = Measures(lambda _a, b: -b)
    settled, _ = settle(split(1, 0.0, leaf(0), leaf(1)), GRAMMAR, Measures(lambda b: -b))
    assert thresholds(settled) == [0.0]
    settle(tree_of(-1.0, 0.0), GRAMMAR, measures)
    assert measures.batches == [1, 6]


def test_what_is_no_constant_or_of_no_range_does_not_move():
    for tree in (leaf(0), split(0, 0.123, leaf(0), leaf(1)), split(2, 0.0, leaf(0), leaf(1))):
        measures = Measures(lambda *_: 0.0)
        assert settle(tree, GRAMMAR, measures) == (tree, 10)
