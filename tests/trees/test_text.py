import json

import numpy as np
import pytest
from documents_for_tests import WIDE, names_for
from hypothesis import given
from hypothesis import strategies as st
from strategies import any_trees, float32s

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.controller import Names
from ge_torchrl.trees.text import leaf_text, render_rules, render_text, shortest_decimal, split_text
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split

CARTPOLE = Names(
    id="CartPole-v1",
    features=("x", "x_dot", "theta", "theta_dot"),
    units=("m", "m/s", "rad", "rad/s"),
    actions=("left", "right"),
)
ACROBOT = Names(
    id="Acrobot-v1",
    features=("cos_theta1", "sin_theta1", "cos_theta2", "sin_theta2", "theta1_dot", "theta2_dot"),
    units=("", "", "", "", "rad/s", "rad/s"),
    actions=("torque -1", "torque 0", "torque +1"),
)
MOUNTAIN_CAR = Names(
    id="MountainCar-v0",
    features=("position", "velocity"),
    units=("", ""),
    actions=("push left", "no push", "push right"),
)

CARTPOLE_TREE = split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1))
ACROBOT_TREE = split(5, -14.2778, leaf(0), split(4, -2.9144, leaf(1), split(5, 0.3094, leaf(0), leaf(2))))
MOUNTAIN_CAR_TREE = split(
    1,
    -0.0005,
    split(0, -1.0361, leaf(2), leaf(0)),
    split(1, 0.0063, split(0, -0.3981, leaf(2), leaf(0)), leaf(2)),
)

CARTPOLE_TEXT = """\
theta < 0.0154 rad?
├─ yes: theta_dot < 0.229 rad/s?
│       ├─ yes: left
│       └─ no:  right
└─ no:  right"""
ACROBOT_TEXT = """\
theta2_dot < -14.2778 rad/s?
├─ yes: torque -1
└─ no:  theta1_dot < -2.9144 rad/s?
        ├─ yes: torque 0
        └─ no:  theta2_dot < 0.3094 rad/s?
                ├─ yes: torque -1
                └─ no:  torque +1"""
MOUNTAIN_CAR_TEXT = """\
velocity < -0.0005?
├─ yes: position < -1.0361?
│       ├─ yes: push right
│       └─ no:  push left
└─ no:  velocity < 0.0063?
        ├─ yes: position < -0.3981?
        │       ├─ yes: push right
        │       └─ no:  push left
        └─ no:  push right"""

CARTPOLE_RULES = """\
if theta < 0.0154 rad and theta_dot < 0.229 rad/s then left
if theta < 0.0154 rad and theta_dot >= 0.229 rad/s then right
if theta >= 0.0154 rad then right"""
ACROBOT_RULES = """\
if theta2_dot < -14.2778 rad/s then torque -1
if theta2_dot >= -14.2778 rad/s and theta1_dot < -2.9144 rad/s then torque 0
if -14.2778 <= theta2_dot < 0.3094 rad/s and theta1_dot >= -2.9144 rad/s then torque -1
if theta2_dot >= 0.3094 rad/s and theta1_dot >= -2.9144 rad/s then torque +1"""
MOUNTAIN_CAR_RULES = """\
if velocity < -0.0005 and position < -1.0361 then push right
if velocity < -0.0005 and position >= -1.0361 then push left
if -0.0005 <= velocity < 0.0063 and position < -0.3981 then push right
if -0.0005 <= velocity < 0.0063 and position >= -0.3981 then push left
if velocity >= 0.0063 then push right"""


@pytest.mark.parametrize(
    ("tree", "names", "text"),
    [
        (CARTPOLE_TREE, CARTPOLE, CARTPOLE_TEXT),
        (ACROBOT_TREE, ACROBOT, ACROBOT_TEXT),
        (MOUNTAIN_CAR_TREE, MOUNTAIN_CAR, MOUNTAIN_CAR_TEXT),
    ],
)
def test_published_trees_as_text(tree, names, text):
    assert render_text(tree, names) == text


@pytest.mark.parametrize(
    ("tree", "names", "rules"),
    [
        (CARTPOLE_TREE, CARTPOLE, CARTPOLE_RULES),
        (ACROBOT_TREE, ACROBOT, ACROBOT_RULES),
        (MOUNTAIN_CAR_TREE, MOUNTAIN_CAR, MOUNTAIN_CAR_RULES),
    ],
)
def test_published_trees_as_rules(tree, names, rules):
    assert render_rules(tree, names) == rules


@pytest.mark.parametrize("render", [render_text, render_rules])
def test_a_lone_leaf_always_answers_the_same(render):
    assert render(leaf(0), CARTPOLE) == "always left"


def test_a_looser_condition_below_a_tighter_one_does_not_widen_the_interval():
    tree = split(0, 1.0, split(0, 2.0, leaf(0), leaf(1)), split(0, -1.0, leaf(0), leaf(1)))
    assert render_rules(tree, CARTPOLE).splitlines() == [
        "if x < 1 m then left",
        "if 2 <= x < 1 m then right",
        "if 1 <= x < -1 m then left",
        "if x >= 1 m then right",
    ]


@pytest.mark.parametrize("render", [render_text, render_rules])
@pytest.mark.parametrize(
    ("tree", "message"),
    [
        (split(4, 0.0, leaf(0), leaf(1)), r"splits\[0\]: CartPole-v1 has features 0 to 3, not 4"),
        (split(0, 0.0, leaf(0), leaf(2)), r"leaves\[1\]: CartPole-v1 has actions 0 to 1, not 2"),
    ],
)
def test_names_that_the_environment_does_not_have_are_refused(render, tree, message):
    with pytest.raises(InvalidTreeError, match=message):
        render(tree, CARTPOLE)


@given(any_trees())
def test_text_has_a_line_a_node_and_rules_a_line_a_leaf(tree):
    names = names_for(tree)
    assert len(render_text(tree, names).splitlines()) == tree.num_decision_nodes + tree.num_leaves
    assert len(render_rules(tree, names).splitlines()) == tree.num_leaves


def test_sums_and_values_as_text():
    assert (
        render_text(WIDE.tree, WIDE.names)
        == """\
2 x - 0.5 theta < 0.25 m?
├─ yes: force = 0.5 + theta_dot - 2 x, torque = 1 + 0.1 x
└─ no:  force = 0, torque = -1"""
    )
    assert (
        render_rules(WIDE.tree, WIDE.names)
        == """\
if 2 x - 0.5 theta < 0.25 m then force = 0.5 + theta_dot - 2 x, torque = 1 + 0.1 x
if 2 x - 0.5 theta >= 0.25 m then force = 0, torque = -1"""
    )


def test_conditions_on_one_sum_are_joined():
    def weighted(threshold, left, right):
        return DecisionTree.weighted_split([2, 3], [-1.0, 1.0], threshold, left, right)

    tree = weighted(0.5, weighted(0.25, leaf(0), leaf(1)), leaf(0))
    assert render_rules(tree, CARTPOLE).splitlines() == [
        "if -theta + theta_dot < 0.25 then left",
        "if 0.25 <= -theta + theta_dot < 0.5 then right",
        "if -theta + theta_dot >= 0.5 then left",
    ]


def test_one_split_and_one_leaf():
    assert split_text(CARTPOLE_TREE, CARTPOLE, 1) == "theta_dot < 0.229 rad/s"
    assert leaf_text(CARTPOLE_TREE, CARTPOLE, 2) == "right"
    linear = DecisionTree.value_leaf([0.0, 0.0], {1: [-1.0, 0.0]})
    assert leaf_text(linear, WIDE.names, 0) == "force = -x_dot, torque = 0"
    assert render_rules(linear, WIDE.names) == "always force = -x_dot, torque = 0"


@pytest.mark.parametrize(
    ("value", "shortest"),
    [
        (0.0154, 0.0154),
        (0.229, 0.229),
        (-14.2778, -14.2778),
        (1 / 3, 0.33333334),
        (16777216.0, 16777216.0),
        (3.4028235e38, 3.4028235e38),
        (1e-45, 1e-45),
        (0.0, 0.0),
    ],
)
def test_shortest_decimal_of_known_values(value, shortest):
    assert repr(shortest_decimal(np.float32(value))) == repr(shortest)


@given(float32s() | st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_shortest_decimal_reads_back_and_is_as_short_as_numpy_finds(value):
    decimal = shortest_decimal(value)
    assert np.float32(decimal) == np.float32(value)
    assert len(significand(decimal)) <= len(significand(np.format_float_scientific(np.float32(value))))
    assert json.loads(json.dumps(decimal)) == decimal


def significand(number):
    return str(number).lower().split("e")[0].replace("-", "").replace(".", "").strip("0")
