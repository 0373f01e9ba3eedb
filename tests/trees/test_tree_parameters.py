import numpy as np
import pytest
from arrays_for_tests import TREE
from hypothesis import given
from hypothesis import strategies as st
from strategies import any_trees, float32s

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split


@given(any_trees())
def test_parameters_come_back(tree):
    assert tree.with_parameters(tree.parameters) == tree


@given(st.data(), any_trees())
def test_other_parameters_leave_the_structure_and_are_kept(data, tree):
    n = len(tree.parameters)
    numbers = data.draw(st.lists(float32s(), min_size=n, max_size=n))
    other = tree.with_parameters(numbers)
    assert other.structure == tree.structure
    assert np.array_equal(other.parameters, np.float32(numbers))
    assert (other == tree) == (other.parameters.tobytes() == tree.parameters.tobytes())
    assert DecisionTree(*other.arrays) == other


@given(any_trees(), any_trees())
def test_structures_are_equal_exactly_where_only_numbers_differ(one, other):
    differ_in_numbers = (
        len(one.parameters) == len(other.parameters) and one.with_parameters(other.parameters) == other
    )
    assert (one.structure == other.structure) == differ_in_numbers


def test_parameters_stand_in_their_order():
    below = split(
        0,
        0.5,
        DecisionTree.value_leaf([10.0, 11.0], {1: [20.0, 21.0]}),
        DecisionTree.value_leaf([12.0, 13.0]),
    )
    tree = DecisionTree.weighted_split([0, 3], [2.0, 3.0], -1.0, DecisionTree.value_leaf([8.0, 9.0]), below)
    assert tree.parameters.tolist() == [-1.0, 0.5, 2.0, 3.0, 8, 9, 10, 11, 12, 13, 20, 21]
    spread = np.array([4.0, 2.0, 1.0, 0.5])
    of_sum = np.hypot(2 * 4, 3 * 0.5)
    expected = [of_sum, 4.0, of_sum / 4, of_sum / 0.5, *[1.0] * 6, 0.5, 0.5]
    assert tree.parameter_units(spread) == pytest.approx(expected)
    expected[4:] = [*[3.0, 5.0] * 3, 3.0 / 2, 5.0 / 2]
    assert tree.parameter_units(spread, np.array([3.0, 5.0])) == pytest.approx(expected)


@given(any_trees())
def test_every_parameter_has_a_step(tree):
    units = tree.parameter_units(np.array([0.5, 1.0, 2.0, 4.0]), np.ones(tree.value.shape[1]))
    assert units.shape == tree.parameters.shape
    assert (units > 0).all()


def test_the_weight_of_a_lone_term_is_no_parameter():
    scaled = DecisionTree.weighted_split([0], [2.0], 1.0, leaf(0), leaf(1))
    assert not scaled.is_axis_aligned
    assert scaled.parameters.tolist() == [1.0]
    assert scaled.structure != split(0, 1.0, leaf(0), leaf(1)).structure
    assert scaled.parameter_units(np.array([3.0])).tolist() == [6.0]


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ([0.5], "has 2 parameters; 1 were given"),
        ([0.5, np.nan], r"parameters\[1\] must be a finite float32, not nan"),
        ([1e39, 0.5], r"parameters\[0\] must be a finite float32, not 1e\+39"),
    ],
)
def test_parameters_of_something_else_are_refused(numbers, message):
    with pytest.raises(InvalidTreeError, match=message):
        TREE.with_parameters(numbers)


def test_how_far_actions_spread_is_of_no_account_where_leaves_hold_actions():
    tree = DecisionTree.split(0, 0.5, DecisionTree.leaf(0), DecisionTree.leaf(1))
    spread = np.array([2.0, 3.0])
    assert tree.parameter_units(spread, np.array([7.0, 7.0])).tolist() == [2.0]
