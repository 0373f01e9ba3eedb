import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from documents_for_tests import CONTROLLER, NAMES, WIDE, names_for
from hypothesis import given
from hypothesis import strategies as st
from strategies import any_trees, observations

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split


@given(st.data(), any_trees())
def test_a_controller_answers_as_its_tree(data, tree):
    controller = Controller(tree, names_for(tree))
    for row in data.draw(observations(tree)):
        answer = tree.decide(row[np.newaxis])[0]
        if not tree.has_actions:
            answer = np.clip(answer, *np.float32(controller.names.action_bounds).T)
        assert np.array_equal(controller(row), answer, equal_nan=True)


def test_values_are_clipped_to_the_bounds_of_actions_where_there_are_any():
    names = replace(WIDE.names, action_bounds=((-2.0, 0.1), (-math.inf, 3.0)))
    controller = Controller(DecisionTree.value_leaf([0.0, 0.0], {0: [1.0, 1.0]}), names)
    assert controller([1, 0, 0, 0]).tolist() == [float(np.float32(0.1)), 1.0]
    assert controller([-5, 0, 0, 0]).tolist() == [-2.0, -5.0]
    assert controller([math.inf, 0, 0, 0]).tolist() == [float(np.float32(0.1)), 3.0]
    assert controller([1, 0, 0, 0]).dtype == np.float32
    unbounded = Controller(controller.tree, replace(names, action_bounds=()))
    assert unbounded([-5, 0, 0, 0]).tolist() == [-5.0, -5.0]
    assert unbounded([-5, 0, 0, 0]).flags.writeable


def test_an_action_is_a_plain_number_whatever_the_observation_is_made_of():
    assert type(CONTROLLER([0, 0, 0, 0])) is int
    assert CONTROLLER(np.zeros(4)) == 0
    assert CONTROLLER((0.0, 0.0, 1e300, 0.0)) == 1
    assert WIDE([1.0, 0.0, 0.0, 0.0]).tolist() == np.float32([0.0, -0.1]).tolist()


@pytest.mark.parametrize("observation", [[0.0] * 3, [[0.0] * 4], 0.0])
def test_another_number_of_features_is_refused(observation):
    with pytest.raises(ValueError, match="CartPole-v1 is observed by 4 features; this observation has shape"):
        CONTROLLER(observation)


@pytest.mark.parametrize("provenance", [{"run": Path()}, {"fitness": math.inf}, {1j: 0}])
def test_what_is_no_json_is_refused_at_birth(provenance):
    with pytest.raises(InvalidTreeError, match="provenance: expected a JSON object"):
        Controller(leaf(0), NAMES, provenance)
    with pytest.raises(InvalidTreeError, match=r"environment\.kwargs: expected a JSON object"):
        replace(NAMES, kwargs=provenance)


@pytest.mark.parametrize(
    ("tree", "message"),
    [
        (leaf(2), r"leaves\[0\]: CartPole-v1 has actions 0 to 1, not 2"),
        (split(0, 0.5, leaf(0), leaf(3)), r"leaves\[1\]: CartPole-v1 has actions 0 to 1, not 3"),
        (
            split(0, 0.5, split(4, 0.5, leaf(0), leaf(1)), leaf(0)),
            r"splits\[1\]: CartPole-v1 has features 0 to 3",
        ),
        (
            DecisionTree.value_leaf([1.0, 2.0], {4: [0.0, 1.0]}),
            r"leaves\[0\]: CartPole-v1 has features 0 to 3",
        ),
        (DecisionTree.value_leaf([1.0]), r"leaves\[0\].value: CartPole-v1 takes 2 values, not 1"),
    ],
)
def test_a_tree_that_the_environment_cannot_run_is_refused_at_birth(tree, message):
    with pytest.raises(InvalidTreeError, match=message):
        Controller(tree, NAMES)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"units": ("m",)}, "4 features and 1 units"),
        ({"features": (), "units": ()}, r"environment\.features: expected at least one name"),
        ({"actions": ()}, r"environment\.actions: expected at least one name"),
        ({"max_episode_steps": 0}, r"environment\.max_episode_steps: expected at least 1"),
        ({"action_bounds": ((0.0, 1.0),)}, r"environment\.action_bounds: .* each of the 2 actions .* got 1"),
        (
            {"action_bounds": ((0.0, 1.0), (1.0, 0.0))},
            r"environment\.action_bounds\[1\]: .* got 1\.0 and 0\.0",
        ),
        ({"action_bounds": ((math.nan, 1.0), (0.0, 1.0))}, r"action_bounds\[0\]: .* got nan and 1\.0"),
        ({"action_bounds": ((math.inf, math.inf), (0.0, 1.0))}, r"action_bounds\[0\]: .* got inf and inf"),
    ],
)
def test_names_that_name_nothing_are_refused(changes, message):
    with pytest.raises(InvalidTreeError, match=message):
        replace(NAMES, **changes)


def test_a_value_spreads_over_half_of_its_range():
    names = replace(WIDE.names, action_bounds=((-2.0, 3.0), (-math.inf, 3.0)))
    assert names.action_spread.tolist() == [2.5, 1.0]
    assert replace(names, action_bounds=((1.0, 1.0), (0.0, 8.0))).action_spread.tolist() == [1.0, 4.0]
    assert NAMES.action_spread.tolist() == [1.0, 1.0]


def test_a_choice_is_no_answer_within_bounds():
    with pytest.raises(InvalidTreeError, match=r"leaves\[0\]\.action: Somewhere-v0 takes 2 values within"):
        Controller(leaf(0), WIDE.names)


def test_provenance_is_copied_and_counts_in_equality():
    provenance = {"seeds": [1]}
    controller = Controller(leaf(0), NAMES, provenance)
    provenance["seeds"].append(2)
    assert controller.provenance == {"seeds": [1]}
    assert controller != Controller(leaf(0), NAMES, provenance)
    assert hash(controller) == hash(Controller(leaf(0), NAMES, provenance))
