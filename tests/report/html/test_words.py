"""A rule in words says what its tree does, and a formula is set with the symbols of its features."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweeps_for_tests import CARTPOLE, PRUNED

from ge_torchrl.report.html.trees import tree_values
from ge_torchrl.report.html.words import formulas_of, rules_of, symbol
from ge_torchrl.trees.controller import Controller, Names
from ge_torchrl.trees.tree import DecisionTree

PENDULUM = Names(
    "Pendulum-v1",
    ("cos_theta", "sin_theta", "theta_dot"),
    ("", "", "rad/s"),
    ("torque",),
    action_bounds=((-2, 2),),
)
DOT = "\u0307"


def test_a_rule_says_for_each_answer_when_it_is_given():
    assert rules_of(PRUNED, CARTPOLE) == [
        {
            "answer": ["left"],
            "ways": [
                {"leaf": 0, "conditions": ["theta is below 0.0154 rad", "theta_dot is below 0.229 rad/s"]},
            ],
        },
        {
            "answer": ["right"],
            "ways": [
                {"leaf": 1, "conditions": ["theta is below 0.0154 rad", "theta_dot is at least 0.229 rad/s"]},
                {"leaf": 2, "conditions": ["theta is at least 0.0154 rad"]},
            ],
        },
    ]
    assert rules_of(DecisionTree.leaf(1), CARTPOLE) == [
        {"answer": ["right"], "ways": [{"leaf": 0, "conditions": []}]}
    ]


def test_conditions_on_one_sum_become_one_interval():
    inner = DecisionTree.split(0, -0.5, DecisionTree.leaf(0), DecisionTree.leaf(1))
    tree = DecisionTree.split(0, 1.0, inner, DecisionTree.leaf(0))
    (way,) = rules_of(tree, CARTPOLE)[1]["ways"]
    assert way["conditions"] == ["x is from \u22120.5 to below 1 m"]
    summed = DecisionTree.weighted_split(
        [0, 2], [-1.0, 2.5], 0.25, DecisionTree.leaf(0), DecisionTree.leaf(1)
    )
    assert rules_of(summed, CARTPOLE)[0]["ways"][0]["conditions"] == ["\u2212x + 2.5 theta is below 0.25"]


def test_a_formula_has_a_case_for_each_leaf_and_its_bounds():
    steep = DecisionTree.value_leaf([0.0], {1: [-4.0], 2: [1.0]})
    flat = DecisionTree.value_leaf([1.5])
    (formula,) = formulas_of(DecisionTree.split(0, -0.1, flat, steep), PENDULUM)
    assert formula == {
        "name": "torque",
        "low": -2.0,
        "high": 2.0,
        "cases": [
            {"terms": [[1.5, ""]], "when": ["cos θ < \u22120.1"]},
            {"terms": [[-4.0, "sin θ"], [1.0, "θ" + DOT]], "when": ["cos θ ≥ \u22120.1"]},
        ],
    }
    assert formulas_of(DecisionTree.split(0, -0.1, flat, flat), PENDULUM) == [], "constants need no formula"
    assert formulas_of(PRUNED, CARTPOLE) == []


@pytest.mark.parametrize(
    ("name", "set_as"),
    [("theta_dot", "θ" + DOT), ("cos_theta1", "cos θ₁"), ("omega2", "ω₂"), ("x_dot", "x" + DOT), ("y", "y"),
     ("left_leg", "left_leg"), ("position", "position"), ("<b>", "<b>")],
)  # fmt: skip
def test_symbols(name, set_as):
    assert symbol(name) == set_as


@given(st.lists(st.integers(0, 10**6), min_size=3, max_size=3))
def test_visits_of_splits_are_the_sums_of_their_leaves(visits):
    values = tree_values(Controller(PRUNED, CARTPOLE), np.array(visits))
    assert [leaf["visits"] for leaf in values["leaves"]] == visits
    assert [split["visits"] for split in values["splits"]] == [sum(visits), sum(visits[:2])]


def test_visits_of_another_tree_are_left_out():
    values = tree_values(Controller(PRUNED, CARTPOLE), np.array([1, 2]))
    assert {node["visits"] for node in values["splits"] + values["leaves"]} == {None}
