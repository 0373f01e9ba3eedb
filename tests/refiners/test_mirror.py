"""What is tied in the mirror: a tree that is its own image stays so, whatever its free numbers are."""

from __future__ import annotations

import numpy as np
import pytest
from halves_for_tests import halves
from hypothesis import given
from hypothesis import strategies as st
from mirrors_for_tests import MIRRORS, NAMES, shapes_of

from ge_torchrl.errors import ConfigError
from ge_torchrl.refiners.folding import half_of, whole_of
from ge_torchrl.refiners.mirror import Mirror
from ge_torchrl.refiners.ties import Ties, ties_of
from ge_torchrl.trees.nodes import Split, forest_of
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
LANDER = MIRRORS["lander"]


@given(st.sampled_from(sorted(MIRRORS)), st.integers(0, 10**6), st.booleans(), st.booleans())
def test_a_dense_start_is_its_own_image_and_has_fewer_free_numbers(name, seed, oblique, linear):
    mirror, rng = MIRRORS[name], np.random.default_rng(seed)
    tree = shapes_of(name, rng, oblique=oblique, linear=linear).draw(rng)
    ties = ties_of(tree, mirror)
    assert ties is not None
    free = tree.parameters.astype(np.float64)[ties.leading]
    np.testing.assert_array_equal(ties.parameters(free).astype(np.float32), tree.parameters)
    if tree.num_decision_nodes > 0:
        assert len(free) < len(tree.parameters)


@given(st.sampled_from(sorted(MIRRORS)), st.integers(0, 10**6))
def test_whatever_its_free_numbers_it_stays_tied(name, seed):
    mirror, rng = MIRRORS[name], np.random.default_rng(seed)
    tree = shapes_of(name, rng).draw(rng)
    ties = ties_of(tree, mirror)
    moved = tree.with_parameters(ties.parameters(rng.normal(size=len(ties.leading))))
    again = ties_of(moved, mirror)
    assert again is not None
    np.testing.assert_array_equal(again.sign, ties.sign)
    np.testing.assert_array_equal(again.free, ties.free)


@given(halves())
def test_a_folded_tree_is_tied_as_its_half_is_though_a_split_stands_twice_in_it(half):
    whole = whole_of(half, LANDER)
    if whole is None:
        return
    tree = forest_of([whole]).tree(0)
    ties = ties_of(tree, LANDER)
    assert ties is not None
    n_splits = sum(isinstance(node, Split) for node in half_of(tree, LANDER))
    assert len(ties.leading) <= n_splits
    free = tree.parameters.astype(np.float64)[ties.leading]
    np.testing.assert_array_equal(ties.parameters(free).astype(np.float32), tree.parameters)
    # Away from 0 no test changes what kind it is.
    moved = tree.with_parameters(ties.parameters(np.sign(free) * (np.abs(free) + 0.1)))
    again = half_of(moved, LANDER)
    assert again is not None
    assert forest_of([whole_of(again, LANDER)]).tree(0) == moved


@given(st.integers(0, 10**6))
def test_without_splits_that_contradict_each_other_a_tied_tree_answers_in_the_mirror_what_it_answers(seed):
    rng = np.random.default_rng(seed)
    for name in ("cart", "pendulum", "lander with two engines"):
        mirror = MIRRORS[name]
        tree = shapes_of(name, rng).draw(rng)
        observed = rng.normal(size=(200, len(mirror.feature))).astype(np.float32)
        image = mirror.answers(tree.decide(mirror.observations(observed)))
        np.testing.assert_allclose(tree.decide(observed), image, rtol=1e-4, atol=1e-4)


@given(st.integers(0, 10**6))
def test_the_mirror_of_the_mirror_is_the_state(seed):
    rng = np.random.default_rng(seed)
    for mirror in MIRRORS.values():
        observed = rng.normal(size=(5, len(mirror.feature))).astype(np.float32)
        np.testing.assert_array_equal(mirror.observations(mirror.observations(observed)), observed)


@given(st.integers(0, 10**6), st.sampled_from(sorted(MIRRORS)))
def test_a_tree_in_the_mirror_answers_to_a_mirrored_state_the_mirrored_answer(seed, name):
    mirror, rng = MIRRORS[name], np.random.default_rng(seed)
    tree = shapes_of(name, rng, mirrored=False).draw(rng)
    observed = rng.normal(size=(100, len(mirror.feature))).astype(np.float32)
    image = mirror.tree(tree).decide(mirror.observations(observed))
    np.testing.assert_allclose(image, mirror.answers(tree.decide(observed)), rtol=1e-4, atol=1e-4)
    assert mirror.tree(mirror.tree(tree)) == tree


def test_a_complement_is_an_image_too():
    # Between -0.5 and 0.5 the middle action, outside of it the engine that pushes back.
    tree = split(0, -0.5, leaf(3), split(0, 0.5, leaf(0), leaf(1)))
    ties = ties_of(tree, LANDER)
    assert ties.free.tolist() == [0, 0]
    assert ties.sign.tolist() == [1.0, -1.0]


def test_a_test_at_zero_stays_there():
    ties = ties_of(split(0, 0.0, leaf(3), leaf(1)), LANDER)
    assert ties.sign.tolist() == [0.0]
    assert ties.parameters(np.zeros(0)).tolist() == [0.0]


@pytest.mark.parametrize(
    "tree",
    [
        split(0, 0.3, leaf(1), leaf(3)),  # The image of x < 0.3 is x > -0.3.
        split(0, 0.0, leaf(1), leaf(2)),  # The image of the left engine is the right one.
        split(1, 0.3, leaf(1), leaf(0)),  # Below 0.3 the left engine alone answers.
        split(6, 0.5, leaf(0), leaf(2)),  # The image of the left leg is the right one.
    ],
)
def test_a_tree_that_is_not_its_own_image_is_not_tied(tree):
    assert ties_of(tree, LANDER) is None


def test_without_ties_all_numbers_are_free():
    ties = Ties.none(3)
    assert ties.leading.tolist() == [0, 1, 2]
    assert ties.parameters(np.array([1.0, 2.0, 3.0])).tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("symmetry", "message"),
    [
        ({"negated": ["x"]}, "env.symmetry has the keys .*; negated is not one of them"),
        ({"negate": ["z"]}, "'z' is none of the names x, y"),
        ({"swap": [["left_leg", "left_leg"]]}, "names an entry once"),
        ({"swap": [["left_leg", "right_leg"], ["x", "left_leg"]]}, "names an entry once"),
        ({"swap": ["xy"]}, "takes pairs of names"),
        ({"swap": [["x", ["y"]]]}, r"env\.symmetry\.swap: \['y'\] is none of the names"),
        (
            {"swap": {"x": "y"}},
            r"env\.symmetry\.swap takes pairs of names, such as swap: \[\[x, y\]\]; got {'x'",
        ),
        (
            {"swap": ["x", "y"]},
            r"such as swap: \[\[x, y\]\]; got \['x', 'y'\]; type env\.symmetry\.swap='\[\[x,y\]\]'",
        ),
        ({"swap": 3}, r"env\.symmetry\.swap takes pairs of names, such as swap: \[\[x, \w+\]\]; got 3"),
        ({"swap": None}, r"env\.symmetry\.swap takes pairs of names, .*; got null"),
        ({"negate": 3}, r"env\.symmetry\.negate must be a list of names, such as negate: \[x\]; got 3"),
        ({"negate": None}, r"env\.symmetry\.negate must be a list of names, .*; got null"),
        ({"negate": "xy"}, r"env\.symmetry\.negate must be a list of names, .*; got 'xy'"),
        ({"negate": "y"}, r"env\.symmetry\.negate must be a list of names, such as negate: \[y\]; got 'y'"),
        ({"negate": [["x"]]}, r"env\.symmetry\.negate: \['x'\] is none of the names"),
        ({"negate": ["psi"]}, r"env\.symmetry\.negate: 'psi' is none of the names"),
        ({"actions": 3}, r"env\.symmetry\.actions takes pairs of names, such as actions: "),
        ({"actions": {"left": 3}}, r"env\.symmetry\.actions: 3 is none of the names"),
        ({"negate_actions": "left"}, r"env\.symmetry\.negate_actions must be a list of names"),
        ({"negate_actions": ["up"]}, r"env\.symmetry\.negate_actions: 'up' is none of the names"),
        ({"swap": [["left_leg", "right_leg"]], "negate": ["left_leg"]}, "both or none change their sign"),
        ({"actions": {"left": "up"}}, "'up' is none of the names"),
        ({"negate_actions": ["left"]}, "env.symmetry.negate_actions is for continuous actions"),
    ],
)
def test_a_mirror_that_there_cannot_be_is_refused(symmetry, message):
    with pytest.raises(ConfigError, match=message):
        Mirror.declared(symmetry, NAMES["lander"])


def test_a_plant_is_told_by_its_own_key():
    with pytest.raises(ConfigError, match=r"^mine\.py:Mine\.symmetry\.negate: 'z' is none of the names"):
        Mirror.declared({"negate": ["z"]}, NAMES["lander"], "mine.py:Mine.symmetry")
