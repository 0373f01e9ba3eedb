"""Law 1 for weighted sums and for values at leaves: any codons give a valid tree, or explicitly none."""

from __future__ import annotations

import numpy as np
import pytest
from grammars_for_tests import ACTIONS, FEATURES, equal, genotypes, map_alike_however_often_and_however_many
from hypothesis import given
from hypothesis import strategies as st
from reference_mapper import OutOfCodonsError, ReferenceMapper
from sum_grammars_for_tests import force_like, grammars_with_terms, patient, two_like

from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.ge.operators import random_population
from ge_torchrl.ge.rule_tables import compile_rules
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

leaf = DecisionTree.leaf


def mapped(text, codons, actions=("force",), **options):
    grammar = read_grammar(text, FEATURES, actions, **{"continuous": True, **options})
    return map_population(np.array([codons], np.int32), compile_rules(grammar)).tree(0)


@patient
@given(grammars_with_terms(), st.lists(genotypes(), min_size=1, max_size=4), st.integers(0, 2))
def test_kernel_maps_as_the_reference_does(grammar, rows, wraps):
    length = min(map(len, rows))
    codons = np.stack([row[:length] for row in rows])
    tables = compile_rules(grammar)
    forest = map_population(codons, tables, wraps)
    trees = []
    for individual, genotype in enumerate(codons):
        try:
            trees.append(ReferenceMapper(grammar, genotype, wraps, tables.feature_rank).tree())
        except OutOfCodonsError:
            assert not forest.valid[individual]
            continue
        assert forest.valid[individual]
        tree = forest.tree(individual)
        assert tree == trees[-1]
        assert DecisionTree(**tree.arrays._asdict()) == tree, "its arrays pass the checks as they are"
    kept = forest.take(np.flatnonzero(forest.valid))
    assert len(kept) == len(trees)
    assert not trees or equal(kept, Forest.stack(trees)), "depth first, as in a tree"


@patient
@given(grammars_with_terms(), st.lists(genotypes(), min_size=1, max_size=4), st.integers(0, 2))
def test_the_same_codons_give_the_same_trees(grammar, rows, wraps):
    assert map_alike_however_often_and_however_many(grammar, rows, wraps)


def test_golden_derivation():
    #        if, sum, f0  -1.5    +, f1  2   last   0.5   leaf, linear 0.5  f0 2, last; leaf alone -0.75
    codons = [1, 0, 1, 0, 1, 0, 1, 6, 6, 0, 1, 3, 0, 0, 8, 0, 0, 1, 77]
    forest = map_population(np.array([codons], np.int32), compile_rules(force_like()))
    expected = DecisionTree.weighted_split(
        [0, 1], [-1.5, 2.0], 0.5, DecisionTree.value_leaf([0.5], {0: [2.0]}), DecisionTree.value_leaf([-0.75])
    )
    assert forest.tree(0) == expected


def test_a_sum_keeps_its_terms_in_order_and_twice_where_they_stand_twice():
    text = "<t> ::= if lt(f1 + 2 * f0 + f1 -0.5 * f0, 3) then act(f1 + 0 * f0 + f1) else act(1 +2 * f0)"
    tree = mapped(text, [])
    assert tree.feature.tolist() == [1, 0, 1, 0]
    assert tree.weight.tolist() == [1, 2, 1, -0.5]
    assert tree.leaf_feature.tolist() == [1, 0, 1, 0]
    assert tree.leaf_weight.tolist() == [[1], [0], [1], [2]]
    assert tree.value.tolist() == [[0], [1]]


def test_entries_share_terms_in_the_order_in_which_the_text_names_features():
    text = "<t> ::= act(2 + 3 * f1 + f0, 4 * f0 + 5 * f0 + 0 * f1)"
    tree = mapped(text, [], ("force", "brake"))
    assert tree.value.tolist() == [[2, 0]]
    assert tree.leaf_feature.tolist() == [1, 0, 0]
    assert tree.leaf_weight.tolist() == [[3, 0], [1, 4], [0, 5]]


def test_a_lone_term_of_weight_1_is_axis_aligned():
    for condition in ("lt(f1, 0.5)", "lt(1 * f1, 0.5)"):
        tree = mapped(f"<t> ::= if {condition} then a0 else a1", [], ACTIONS, continuous=False)
        assert tree == DecisionTree.split(1, 0.5, leaf(0), leaf(1))
        assert tree.is_axis_aligned


def test_invalid_individuals_leave_no_trace():
    endless, short = [1, 0, 1] * 4, [0, 0, 1, *[0] * 9]
    forest = map_population(np.array([endless, short, endless, short], np.int32), compile_rules(force_like()))
    assert forest.valid.tolist() == [False, True, False, True]
    assert forest.arrays.leaf_start.tolist() == [0, 0, 1, 1, 2]
    assert forest.n_values == 1
    assert forest.tree(1) == forest.tree(3) == DecisionTree.value_leaf([-0.75])


def test_no_individual_has_a_tree():
    forest = map_population(np.ones((3, 2), np.int32), compile_rules(two_like()))
    assert not forest.valid.any()
    assert forest.n_values == 2


def test_a_buffer_that_is_too_small_grows():
    # 100 splits a tree, each a sum of six terms.
    split = [1, 0] + [1, 0, 3] * 5 + [0, 0, 3, 2]
    codons = np.tile(np.array([*split, 0, 0, 4] * 100 + [0, 0, 4], np.int32), (30, 1))
    forest = map_population(codons, compile_rules(force_like()))
    assert forest.num_decision_nodes.tolist() == [100] * 30
    assert np.diff(forest.arrays.term_start).tolist() == [6] * 3000
    assert forest.tree(29) == forest.tree(0)


@pytest.mark.parametrize("grammar", [force_like(), two_like()])
def test_the_forest_owns_compact_arrays(grammar):
    forest = map_population(random_population(50, 40, np.random.default_rng(0)), compile_rules(grammar))
    for array in forest.arrays:
        assert array.base is None
        assert array.flags.c_contiguous
    assert equal(forest.take(np.arange(50)), forest)
