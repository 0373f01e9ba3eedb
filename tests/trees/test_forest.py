import numpy as np
import pytest
from forests_for_tests import NO_TREE
from hypothesis import given
from hypothesis import strategies as st
from strategies import any_trees, float32s, observations, trees_of_one_kind

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split


@st.composite
def forests(draw, kind=None):
    """A forest, and its trees: None where an individual has none."""
    of_kind = draw(trees_of_one_kind()) if kind is None else kind
    individuals = draw(st.lists(st.none() | of_kind, max_size=6))
    parts = [NO_TREE if tree is None else Forest.stack([tree]) for tree in individuals]
    return Forest.concatenate(parts), individuals


def same(forest, individuals):
    assert len(forest) == len(individuals)
    assert forest.valid.tolist() == [tree is not None for tree in individuals]
    for index, tree in enumerate(individuals):
        if tree is not None:
            assert forest.tree(index) == tree
            assert forest.structure(index) == tree.structure
            assert forest.num_decision_nodes[index] == tree.num_decision_nodes
        else:
            assert forest.structure(index) == b""
    for array, empty in zip(forest.arrays, Forest.stack([]).arrays, strict=True):
        assert (array.dtype, array.ndim) == (empty.dtype, empty.ndim)
        assert array.flags.c_contiguous
        assert array.flags.writeable
    present = [tree for tree in individuals if tree is not None]
    assert forest.is_axis_aligned == all(tree.is_axis_aligned for tree in present)
    if present:
        assert (forest.has_actions, forest.n_values) == (present[0].has_actions, present[0].value.shape[1])
        for array, expected in zip(forest.arrays[2:], Forest.stack(present).arrays[2:], strict=True):
            assert np.array_equal(array, expected)
            assert array.shape == expected.shape


@given(trees_of_one_kind().flatmap(lambda kind: st.lists(kind, max_size=5)))
def test_every_stacked_tree_comes_back(trees):
    forest = Forest.stack(trees)
    same(forest, trees)
    assert forest.trees() == trees


@given(st.data(), forests())
def test_individuals_are_taken_in_any_order(data, forest_and_trees):
    forest, individuals = forest_and_trees
    same(forest, individuals)
    index = data.draw(st.lists(st.sampled_from(range(len(individuals))), max_size=9)) if individuals else []
    same(forest.take(index), [individuals[place] for place in index])


@given(trees_of_one_kind().flatmap(lambda kind: st.lists(forests(kind), max_size=3)))
def test_forests_are_concatenated(parts):
    expected = [tree for _, individuals in parts for tree in individuals]
    same(Forest.concatenate([forest for forest, _ in parts]), expected)


def test_arrays_stand_end_to_end_and_children_count_from_their_tree():
    arrays = Forest.stack([split(1, 0.5, leaf(0), leaf(1)), leaf(2), split(0, -2.0, leaf(1), leaf(0))]).arrays
    assert arrays.split_start.tolist() == [0, 1, 1, 2]
    assert arrays.leaf_start.tolist() == [0, 2, 3, 5]
    assert arrays.term_start.tolist() == [0, 1, 2]
    assert arrays.feature.tolist() == [1, 0]
    assert arrays.threshold.tolist() == [0.5, -2]
    assert arrays.children_left.tolist() == [~0, ~0]
    assert arrays.children_right.tolist() == [~1, ~1]
    assert arrays.action.tolist() == [0, 1, 2, 1, 0]


def test_an_individual_without_a_tree_is_refused_by_name():
    forest = Forest.concatenate([Forest.stack([leaf(0)]), NO_TREE, Forest.stack([leaf(1)])])
    assert forest.valid.tolist() == [True, False, True]
    assert forest.tree(2) == leaf(1)
    with pytest.raises(InvalidTreeError, match="individual 1 has no tree"):
        forest.tree(1)


@pytest.mark.parametrize("index", [-1, 1])
def test_an_individual_outside_of_the_forest_is_refused(index):
    with pytest.raises(IndexError, match=f"individuals 0 to 0, not {index}"):
        Forest.stack([leaf(0)]).tree(index)


def test_a_forest_of_several_kinds_is_refused():
    two, three = DecisionTree.value_leaf([1.0, 2.0]), DecisionTree.value_leaf([1.0, 2.0, 3.0])
    with pytest.raises(InvalidTreeError, match="of tree 0 hold actions, those of tree 1 hold 2 values each"):
        Forest.stack([leaf(0), two])
    with pytest.raises(InvalidTreeError, match="of tree 0 hold 2 values each, those of tree 1 hold 3 values"):
        Forest.stack([two, three])
    with pytest.raises(
        InvalidTreeError, match="of forest 0 hold 3 values each, those of forest 1 hold action"
    ):
        Forest.concatenate([Forest.stack([three]), Forest.stack([leaf(0)])])


def test_copies_need_as_many_parameters_as_the_tree_has():
    with pytest.raises(InvalidTreeError, match=r"need \[R, 1\] parameters; \[1, 2\] were given"):
        Forest.of_parameters(DecisionTree.value_leaf([1.0]), np.zeros((1, 2), np.float32))


def test_individuals_without_a_tree_are_of_any_kind():
    values = Forest.stack([DecisionTree.value_leaf([1.0], {2: [3.0]})])
    both = Forest.concatenate([NO_TREE, values, values.take([0]).take([]), NO_TREE])
    assert (both.n_values, both.valid.tolist()) == (1, [False, True, False])
    assert both.tree(1) == values.tree(0)
    assert Forest.concatenate([both.take([0]), both.take([2])]).n_values == 1


@given(st.data(), trees_of_one_kind().flatmap(lambda kind: st.lists(kind, min_size=1, max_size=4)))
def test_each_observation_is_decided_by_its_own_tree(data, trees):
    forest = Forest.stack(trees)
    rows = np.concatenate([data.draw(observations(tree)) for tree in trees])
    chosen = data.draw(st.lists(st.integers(0, len(trees) - 1), min_size=len(rows), max_size=len(rows)))
    decided = forest.decide(np.array(chosen, dtype=np.int64), rows)
    for p, row, answer in zip(chosen, rows, decided, strict=True):
        expected = trees[p].decide(row[np.newaxis])[0]
        assert answer.dtype == expected.dtype
        assert np.array_equal(answer, expected, equal_nan=not forest.has_actions)


def test_values_are_summed_in_float64_from_the_constant_on_and_then_rounded():
    tree = DecisionTree.value_leaf([1e8, 0.1], {1: [1.0, 0.2], 0: [-1e8, 3.0]})
    row = np.float32([[1.0, 0.25]])
    expected = np.float32([[0.25, np.float32(0.1) + 0.25 * np.float64(np.float32(0.2)) + 3.0]])
    for answer in (tree.decide(row), Forest.stack([tree]).decide(np.zeros(1, np.int64), row)):
        assert answer.dtype == np.float32
        assert answer.tolist() == expected.tolist()


@given(st.data(), any_trees(), st.integers(0, 3))
def test_copies_with_other_parameters_are_the_trees_with_these_parameters(data, tree, n):
    shape = (n, len(tree.parameters))
    rows = [[data.draw(float32s() | st.just(-0.0)) for _ in range(shape[1])] for _ in range(n)]
    numbers = np.array(rows, np.float32).reshape(shape)
    expected = [tree.with_parameters(row) for row in numbers]
    same(Forest.of_parameters(tree, numbers), expected)
    same(Forest.of_parameters(tree, np.asfortranarray(numbers)), expected)


def test_a_tree_of_a_forest_does_not_change_with_it():
    forest = Forest.stack([split(1, 0.5, leaf(0), leaf(1))])
    tree = forest.tree(0)
    forest.arrays.threshold[0] = 7
    assert tree.threshold.tolist() == [0.5]
