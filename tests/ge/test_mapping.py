"""Law 1: any codons and any grammar give a valid tree, or explicitly none."""

from __future__ import annotations

import numpy as np
import pytest
from grammars_for_tests import (
    ACTIONS,
    FEATURES,
    cartpole_like,
    equal,
    genotypes,
    grammars,
    map_alike_however_often_and_however_many,
)
from hypothesis import given
from hypothesis import strategies as st
from reference_mapper import OutOfCodonsError, ReferenceMapper

from ge_torchrl.ge.codons import CODON_LIMIT
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.ge.rule_tables import compile_rules
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

TABLES = compile_rules(cartpole_like())
leaf, split = DecisionTree.leaf, DecisionTree.split


@given(grammars(), st.lists(genotypes(), min_size=1, max_size=4), st.integers(0, 2))
def test_kernel_maps_as_the_reference_does(grammar, rows, wraps):
    length = min(map(len, rows))
    codons = np.stack([row[:length] for row in rows])
    forest = map_population(codons, compile_rules(grammar), wraps)
    trees = []
    for individual, genotype in enumerate(codons):
        try:
            trees.append(ReferenceMapper(grammar, genotype, wraps).tree())
        except OutOfCodonsError:
            assert not forest.valid[individual]
            continue
        assert forest.valid[individual]
        tree = forest.tree(individual)
        assert tree == trees[-1]
        assert DecisionTree(**tree.arrays._asdict()) == tree, "its arrays pass the checks as they are"
    assert equal(forest.take(np.flatnonzero(forest.valid)), Forest.stack(trees)), "depth first, as in a tree"


@given(grammars(), st.lists(genotypes(), min_size=1, max_size=4), st.integers(0, 2))
def test_the_same_codons_give_the_same_trees(grammar, rows, wraps):
    assert map_alike_however_often_and_however_many(grammar, rows, wraps)


def test_golden_derivation():
    #         f1  -0.75 if  f0  0   leaf a2  leaf a1 leaf a0  unread
    codons = [1, 10, 1, 2, 4, 0, 5, 2, 4, 8, 9, 77, 78]
    forest = map_population(np.array([codons], np.int32), TABLES)
    assert forest.tree(0) == split(1, -0.75, split(0, 0, leaf(2), leaf(1)), leaf(0))
    assert forest.arrays.children_left.tolist() == [1, ~0]
    assert forest.arrays.children_right.tolist() == [~2, ~1]
    assert forest.arrays.action.tolist() == [2, 1, 0]


def test_wrapping_begins_anew_at_the_first_codon():
    # f1, -0.5, leaf; and once more from the first: a1, leaf, a0.
    codons = np.array([[1, 2, 0]], np.int32)
    assert not map_population(codons, TABLES, wraps=0).valid[0]
    assert map_population(codons, TABLES, wraps=1).tree(0) == split(1, -0.5, leaf(1), leaf(0))


def test_invalid_individuals_leave_no_trace():
    endless = [0, 0, 1] * 4
    short = [0, 0, 0, 0, 0, 1, *[0] * 6]
    forest = map_population(np.array([endless, short, endless, short], np.int32), TABLES)
    assert forest.valid.tolist() == [False, True, False, True]
    assert forest.arrays.split_start.tolist() == [0, 0, 1, 1, 2]
    assert forest.arrays.leaf_start.tolist() == [0, 0, 2, 2, 4]
    assert forest.tree(1) == forest.tree(3)


def test_a_buffer_that_is_too_small_grows():
    # Every tree is a chain of 170 splits: far more than the buffer begins with.
    genotype = [0, 3] + [0, 2, 1, 0, 3] * 169 + [0, 1, 0, 2]
    codons = np.tile(np.array(genotype, np.int32), (40, 1))
    forest = map_population(codons, TABLES)
    assert forest.num_decision_nodes.tolist() == [170] * 40
    assert forest.tree(39) == forest.tree(0)
    assert forest.tree(0).depth == 170


@pytest.mark.parametrize("shape", [(0, 5), (1, 1), (3, 1)])
def test_small_shapes(shape):
    tables = compile_rules(read_grammar("<t> ::= a0 | a1", FEATURES, ACTIONS))
    forest = map_population(np.ones(shape, np.int32), tables)
    assert forest.arrays.action.tolist() == [1] * shape[0]
    assert len(forest) == shape[0]


def test_a_grammar_without_choices_reads_nothing():
    tables = compile_rules(read_grammar("<t> ::= a2", FEATURES, ACTIONS))
    assert map_population(np.empty((2, 0), np.int32), tables).arrays.action.tolist() == [2, 2]


def test_the_greatest_codon_of_the_greatest_range():
    text = f"<t> ::= if lt(f0, [0, {CODON_LIMIT - 1}] step 1) then a0 else a1"
    tables = compile_rules(read_grammar(text, FEATURES, ACTIONS))
    forest = map_population(np.array([[CODON_LIMIT - 1]], np.int32), tables)
    assert forest.arrays.threshold[0] == np.float32(CODON_LIMIT - 1)


def test_the_forest_owns_compact_arrays():
    forest = map_population(np.zeros((5, 12), np.int32), TABLES)
    assert isinstance(forest, Forest)
    n_splits, n_leaves = forest.arrays.split_start[-1], forest.arrays.leaf_start[-1]
    for name, array in forest.arrays._asdict().items():
        assert array.base is None
        if not name.endswith("start"):
            of_leaves = {"action": n_leaves, "value": n_leaves, "leaf_feature": 0, "leaf_weight": 0}
            assert len(array) == of_leaves.get(name, n_splits)
