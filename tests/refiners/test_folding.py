"""Folded trees: a half says the whole, the whole says its half, and the whole is its own image in the mirror."""

import numpy as np
import pytest
from halves_for_tests import asks, halves
from hypothesis import given
from mirrors_for_tests import MIRRORS

from ge_torchrl.refiners.folding import fold_observations, half_of, tied_leaves, whole_of
from ge_torchrl.trees.nodes import Split, forest_of
from ge_torchrl.trees.tree import DecisionTree

LANDER = MIRRORS["lander"]
NONE, LEFT, MAIN, RIGHT = range(4)


def is_unfolded(nodes):
    """Tell whether nothing tests a leg, of which one may hide what the other shows."""
    return all(not isinstance(node, Split) or node.feature[0] < 6 for node in nodes)


def tree_of(nodes):
    return forest_of([nodes]).tree(0)


# None of the thresholds, so that nothing lies on one.
STATES = (np.random.default_rng(0).integers(-20, 20, (400, 8)) / 16 + 1 / 32).astype(np.float32)


class TestWhole:
    @given(halves())
    def test_it_is_its_own_image(self, half):
        whole = whole_of(half, LANDER)
        if whole is not None:
            tree = tree_of(whole)
            mirrored = tree.decide(LANDER.observations(STATES))
            np.testing.assert_array_equal(mirrored, LANDER.answers(tree.decide(STATES)))

    @given(halves())
    def test_its_half_says_it_again(self, half):
        whole = whole_of(half, LANDER)
        if whole is not None:
            again = half_of(tree_of(whole), LANDER)
            assert again is not None
            assert tree_of(whole_of(again, LANDER)) == tree_of(whole)

    @given(halves(features=6))
    def test_the_half_answers_folded_states_as_the_whole_does_up_to_the_mirror(self, half):
        whole = whole_of(half, LANDER)
        if whole is not None:
            folded = tree_of(half).decide(fold_observations(half, STATES, LANDER))
            answers = tree_of(whole).decide(STATES)
            assert ((folded == answers) | (folded == LANDER.action[answers])).all()

    @given(halves())
    def test_tied_leaves_are_each_others_images(self, half):
        whole = whole_of(half, LANDER)
        if whole is not None:
            tied, tree = tied_leaves(half, LANDER), tree_of(whole)
            assert len(tied) == tree.num_leaves
            one, other = tree.leaf_of(STATES), tree.leaf_of(LANDER.observations(STATES))
            legs_alone = is_unfolded(half)
            np.testing.assert_array_equal(tied[one] if legs_alone else 0, tied[other] if legs_alone else 0)

    def test_an_answer_that_is_not_its_own_image_needs_a_fold(self):
        assert whole_of([LEFT], LANDER) is None
        assert whole_of([asks(1, 0.5), NONE, LEFT], LANDER) is None
        assert whole_of([asks(4, 0.0), NONE, LEFT], LANDER) == [asks(4, 0.0), RIGHT, LEFT]

    def test_how_far_a_feature_lies_from_0_takes_two_tests(self):
        half = [asks(4, 0.25), NONE, RIGHT]
        whole = [asks(4, -0.25), LEFT, asks(4, 0.25), NONE, RIGHT]
        assert whole_of(half, LANDER) == whole
        assert half_of(tree_of(whole), LANDER) == half

    def test_either_of_two_that_change_places(self):
        assert whole_of([asks(6, 0.5), MAIN, NONE], LANDER) == [
            asks(6, 0.5),
            asks(7, 0.5),
            MAIN,
            NONE,
            NONE,
        ]


class TestHalf:
    @pytest.mark.parametrize(
        "nodes",
        [
            [LEFT],
            [asks(4, -0.25), LEFT, asks(4, 0.3), NONE, RIGHT],
            [asks(4, -0.25), LEFT, asks(4, 0.25), NONE, MAIN],
            [asks(4, 0.25), LEFT, RIGHT],
            [asks(6, 0.5), MAIN, NONE],
            [asks(4, 0.0), LEFT, LEFT],
        ],
    )
    def test_other_trees_have_none(self, nodes):
        assert half_of(tree_of(nodes), LANDER) is None

    def test_sums_and_values_have_none(self):
        leaf = DecisionTree.leaf
        sums = DecisionTree.weighted_split([0, 1], [1.0, 0.5], 0.0, leaf(NONE), leaf(NONE))
        assert half_of(sums, LANDER) is None
        assert half_of(DecisionTree.value_leaf([0.0, 0.0]), MIRRORS["lander with two engines"]) is None
