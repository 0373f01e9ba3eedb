"""Rounding keeps what matters of a tree, and no more."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mirrors_for_tests import MIRRORS, shapes_of

from ge_torchrl.environments.backend import LimitReachedError
from ge_torchrl.refiners.rounding import Rounding, scaled, with_decimals, without_zero_terms
from ge_torchrl.refiners.ties import ties_of
from ge_torchrl.trees.tree import DecisionTree

leaf, weighted = DecisionTree.leaf, DecisionTree.weighted_split
SPREAD = np.ones(4)
SEEDS = np.arange(200)
STATES = np.random.default_rng(0).normal(size=(500, 4)).astype(np.float32)
# What is best: the side of a plane through two features.
TARGET = np.where(STATES[:, 0] - 0.5 * STATES[:, 1] < 0.25, 0, 1)
LONG = weighted([0, 1, 2, 3], [8.013, -4.11, 0.021, 0.043], 2.04, leaf(0), leaf(1))


def returns(forest, seeds):
    """Return of a tree: a hundred times how often it answers as it should, and the episode's luck."""
    right = [100 * (tree.decide(STATES) == TARGET).mean() for tree in forest.trees()]
    luck = np.array([np.random.default_rng(seed).normal() for seed in seeds])
    own = np.array([np.random.default_rng(1000 + seed).normal(size=1) for seed in seeds])[:, 0]
    return np.array(right)[:, np.newaxis] + 10 * luck + own * np.arange(len(right))[:, np.newaxis]


def rounded(tree=LONG, mirror=None, measure=returns):
    return Rounding(tree, mirror, SPREAD, SEEDS, measure).run()


def test_what_does_not_matter_goes_and_what_matters_gets_round_numbers():
    tree = rounded()
    assert tree.feature.tolist() == [0, 1]
    np.testing.assert_allclose(np.abs(tree.weight), [1.0, 0.5], atol=0.06)
    assert returns_of(tree) >= returns_of(LONG) - 0.2
    decimals = [len(f"{number:.6f}".rstrip("0").partition(".")[2]) for number in tree.parameters]
    assert max(decimals) <= 2


def returns_of(tree):
    return 100 * (tree.decide(STATES) == TARGET).mean()


def test_a_tree_that_everything_matters_to_stays_as_it_is():
    def measure(forest, seeds):
        return np.array([[float(tree == LONG)] * len(seeds) for tree in forest.trees()])

    assert rounded(measure=measure) == LONG


def test_a_thousandth_of_the_return_is_not_worth_a_digit_and_more_is():
    def losing(loss):
        def measure(forest, seeds):
            return np.array([[100.0 - loss * (tree != LONG)] * len(seeds) for tree in forest.trees()])

        return measure

    assert len(rounded(measure=losing(0.09)).feature) == 1
    assert rounded(measure=losing(0.11)) == LONG


def test_where_nothing_matters_a_split_keeps_the_term_without_which_it_is_none():
    def measure(forest, seeds):
        return np.zeros((len(forest), len(seeds)))

    assert len(rounded(measure=measure).feature) == 1


@given(st.integers(0, 10**6), st.sampled_from(sorted(MIRRORS)), st.integers(0, 2))
def test_a_tree_that_is_its_own_image_stays_so(seed, name, decimals):
    rng = np.random.default_rng(seed)
    shapes = shapes_of(name, rng)
    tree = shapes.draw(rng)
    assert ties_of(scaled(tree, shapes.spread), MIRRORS[name]) is not None
    found = with_decimals(scaled(tree, shapes.spread), shapes.spread, decimals)
    # Rounding may leave a split without terms: a rule with a leaf less need not be its own image.
    if found.num_decision_nodes == tree.num_decision_nodes:
        assert ties_of(found, MIRRORS[name]) is not None


@given(st.integers(0, 10**6), st.sampled_from(sorted(MIRRORS)))
def test_scaling_changes_no_answer_but_by_rounding(seed, name):
    rng = np.random.default_rng(seed)
    shapes = shapes_of(name, rng)
    tree = shapes.draw(rng)
    observed = rng.normal(size=(300, len(shapes.spread))).astype(np.float32)
    found = scaled(tree, shapes.spread)
    assert (found.leaf_of(observed) == tree.leaf_of(observed)).mean() > 0.99
    for split in range(found.num_decision_nodes):
        terms = slice(found.term_start[split], found.term_start[split + 1])
        assert (np.abs(found.weight[terms]) == 1.0).any()


@pytest.mark.parametrize(("threshold", "action"), [(0.5, 0), (0.0, 1), (-0.5, 1)])
def test_a_split_without_terms_goes_where_a_sum_of_zero_does(threshold, action):
    tree = weighted([0, 1], [0.0, 0.0], threshold, leaf(0), leaf(1))
    found = without_zero_terms(tree)
    assert found == leaf(action)
    assert tree.decide(STATES[:1]).tolist() == [action]


def test_terms_of_leaves_go_too():
    tree = DecisionTree.value_leaf([0.5], {0: [0.0], 2: [1.5]})
    assert without_zero_terms(tree) == DecisionTree.value_leaf([0.5], {2: [1.5]})


def test_a_limit_leaves_what_was_rounded_until_then():
    asked = 0

    def until_the_limit(forest, seeds):
        nonlocal asked
        asked += len(forest) * len(seeds)
        if asked > 2.5 * len(SEEDS):
            raise LimitReachedError("max_env_steps")
        return returns(forest, seeds)

    tree = rounded(measure=until_the_limit)
    assert tree != LONG, "its digits are fewer"
    assert returns_of(tree) >= returns_of(LONG) - 0.2


def test_terms_of_one_feature_become_one():
    split = weighted([0, 1, 0], [1.0, 2.0, 3.0], 0.5, leaf(0), leaf(1))
    assert without_zero_terms(split) == weighted([0, 1], [4.0, 2.0], 0.5, leaf(0), leaf(1))
    opposite = weighted([0, 1, 0], [1.0, 2.0, -1.0], 0.5, leaf(0), leaf(1))
    assert without_zero_terms(opposite) == weighted([1], [1.0], 0.25, leaf(0), leaf(1))
