from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from grammars_for_tests import ACTIONS, FEATURES, cartpole_like, genotypes, grammars
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import renumbered_trees, trees

from ge_torchrl.errors import UnencodableTreeError
from ge_torchrl.ge.codons import CODON_LIMIT
from ge_torchrl.ge.encoding import can_derive, encode, snap
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.ge.operators import random_population
from ge_torchrl.ge.rule_tables import compile_rules
from ge_torchrl.trees.decision_tree import DecisionTree

GRAMMAR = cartpole_like()
TABLES = compile_rules(GRAMMAR, single_choice_consumes=False)
LEAF = DecisionTree.leaf


def mapped(codons, tables, wraps=0):
    mapping = map_population(codons[np.newaxis], tables, wraps)
    return mapping.forest.tree(0) if mapping.valid[0] else None


@st.composite
def mapped_genotypes(draw, tables, wraps):
    """A genotype that maps to a tree, and the tree."""
    codons = random_population(
        60, draw(st.integers(1, 60)), np.random.default_rng(draw(st.integers(0, 2**32)))
    )
    mapping = map_population(codons, tables, wraps)
    assume(mapping.valid.any())
    chosen = draw(st.sampled_from(np.flatnonzero(mapping.valid).tolist()))
    return codons[chosen], mapping.forest.tree(chosen)


def altered(tree, draw):
    """The same structure with other thresholds, and here and there another feature or action."""
    split = ~tree.is_leaf
    thresholds = draw(st.lists(st.floats(-1.5, 1.5), min_size=tree.n_nodes, max_size=tree.n_nodes))
    return replace(
        tree,
        threshold=np.where(split, thresholds, 0),
        feature=[draw(st.sampled_from([f, 0, 1])) if f >= 0 else f for f in tree.feature],
        action=[draw(st.sampled_from([a, a, 0, 1, 2])) if a >= 0 else a for a in tree.action],
    )


@given(st.data(), st.integers(0, 1))
def test_altered_trees_of_the_mapping_come_back(data, wraps):
    codons, tree = data.draw(mapped_genotypes(TABLES, wraps))
    target = altered(tree, data.draw)
    try:
        encoded = encode(target, codons, TABLES, wraps)
    except UnencodableTreeError:
        assert wraps == 1
        return
    assert mapped(encoded, TABLES, wraps) == snap(target, GRAMMAR)


@given(trees(2, 3), genotypes(1), st.booleans())
def test_every_tree_with_a_split_comes_back_from_any_genotype(tree, codon, consumes):
    assume(tree.n_nodes > 1)
    tables = compile_rules(GRAMMAR, single_choice_consumes=consumes)
    encoded = encode(tree, np.repeat(codon, 200), tables)
    assert mapped(encoded, tables) == snap(tree, GRAMMAR)
    assert ((encoded >= 0) & (encoded < CODON_LIMIT)).all()


@given(st.data(), grammars(), genotypes(20), st.integers(0, 2), st.booleans())
def test_what_a_grammar_derived_it_derives_again_from_another_genotype(
    data, grammar, others, wraps, consumes
):
    tables = compile_rules(grammar, single_choice_consumes=consumes)
    codons, tree = data.draw(mapped_genotypes(tables, wraps))
    assert (encode(tree, codons, tables, wraps) == codons).all()
    needed = int(map_population(codons[np.newaxis], tables, wraps).codons_read[0])
    enough = np.resize(others, max(needed, 1))
    encoded = encode(tree, enough, tables)
    assert mapped(encoded, tables) == tree


@given(st.data(), grammars(), st.integers(0, 2))
def test_an_encoded_tree_comes_back_or_there_is_an_error(data, grammar, wraps):
    tables = compile_rules(grammar, single_choice_consumes=False)
    codons, tree = data.draw(mapped_genotypes(tables, wraps))
    target = altered(tree, data.draw)
    try:
        encoded = encode(target, codons, tables, wraps)
    except UnencodableTreeError:
        return
    assert mapped(encoded, tables, wraps) == snap(target, grammar)


@given(renumbered_trees(2, 3))
def test_snap_is_idempotent_and_changes_thresholds_and_numbering_only(tree):
    snapped = snap(tree, GRAMMAR)
    assert snap(snapped, GRAMMAR) == snapped
    observations = np.random.default_rng(0).choice([-5.0, 5.0], size=(64, 2))
    clipped = replace(tree, threshold=np.clip(tree.threshold, -1, 1))
    np.testing.assert_array_equal(snapped.decide(observations), clipped.decide(observations))


def test_snap_takes_the_nearest_constant_of_the_nodes_own_feature():
    text = """<t> ::= a0 | if <c> then <t> else <t>
    <c> ::= lt(f0, [0, 10] step 5) | lt(f1, 2) | lt(f1, [-1, 1] step 0.5)"""
    grammar = read_grammar(text, FEATURES, ACTIONS)
    tree = DecisionTree.split(0, 2.6, DecisionTree.split(1, 1.6, LEAF(0), LEAF(0)), LEAF(0))
    assert snap(tree, grammar).threshold.tolist() == [5, 2, 0, 0, 0]
    lower = DecisionTree.split(0, 2.5, DecisionTree.split(1, 1.5, LEAF(0), LEAF(0)), LEAF(0))
    assert snap(lower, grammar).threshold.tolist() == [0, 1, 0, 0, 0]


def test_only_the_codons_of_changed_nodes_change():
    codons = np.array([1, 1000, 1, 2, 904, 10, 500, 2, 400, 8, 9, 77, 78], np.int32)
    before = map_population(codons[np.newaxis], TABLES)
    tree = before.forest.tree(0)
    threshold, action = tree.threshold.copy(), tree.action.copy()
    threshold[1] = 0.6  # Becomes 0.5, number 6 of the range.
    action[3] = 2
    encoded = encode(replace(tree, threshold=threshold, action=action), codons, TABLES)
    # Node 1 owns codons 2 to 4, its constant is the last: 904 - 904 % 9 + 6. Node 3 owns 7 and 8: 400 - 1 + 2.
    assert encoded.tolist() == [1, 1000, 1, 2, 906, 10, 500, 2, 401, 8, 9, 77, 78]
    assert before.first_codon.tolist() == [0, 2, 5, 7, 9]


def test_a_codon_at_the_limit_changes_downwards():
    grammar = read_grammar("<t> ::= a0 | a1 | a2", FEATURES, ACTIONS)
    tables = compile_rules(grammar, single_choice_consumes=False)
    top = CODON_LIMIT - 1  # Its remainder by 3 is 0, the last before the limit.
    assert encode(LEAF(2), np.array([top], np.int32), tables).tolist() == [top - 1]


def test_of_two_derivations_one_that_fits_the_genotype_is_taken():
    text = "<t> ::= <long> | a0\n<long> ::= <longer> | a1\n<longer> ::= a0 | a2"
    tables = compile_rules(read_grammar(text, FEATURES, ACTIONS), single_choice_consumes=False)
    # Codon 0 chooses <long>, from which a0 takes three codons.
    assert encode(LEAF(0), np.array([0, 0, 0], np.int32), tables).tolist() == [0, 0, 0]
    assert encode(LEAF(0), np.array([0, 0], np.int32), tables).tolist() == [1, 0]


def test_one_codon_serves_two_readings_where_their_choices_agree():
    text = "<t> ::= if lt(f0, [0, 2] step 1) then <a> else a0\n<a> ::= a0 | a1"
    tables = compile_rules(read_grammar(text, FEATURES, ACTIONS), single_choice_consumes=False)
    tree = DecisionTree.split(0, 2, LEAF(1), LEAF(0))
    encoded = encode(tree, np.array([0], np.int32), tables, wraps=1)
    assert encoded.tolist() == [5]  # 5 % 3 = 2 and 5 % 2 = 1.
    assert mapped(encoded, tables, 1) == tree


def test_one_codon_cannot_serve_two_choices_that_exclude_each_other():
    text = "<t> ::= if lt(f0, 1) then <a> else <a>\n<a> ::= a0 | a1"
    tables = compile_rules(read_grammar(text, FEATURES, ACTIONS), single_choice_consumes=False)
    with pytest.raises(UnencodableTreeError, match="codon 0 is read again after a wrap"):
        encode(DecisionTree.split(0, 1, LEAF(0), LEAF(1)), np.array([0], np.int32), tables, wraps=1)


def test_refuses_what_the_grammar_cannot_derive():
    codons = np.zeros(50, np.int32)
    with pytest.raises(UnencodableTreeError, match="no derivation from <dt> gives this tree of 1 nodes"):
        encode(LEAF(0), codons, TABLES)
    with pytest.raises(UnencodableTreeError, match="no derivation"):
        encode(DecisionTree.split(0, 0.5, LEAF(0), LEAF(3)), codons, TABLES)
    with pytest.raises(UnencodableTreeError, match="node 0 tests feature number 2"):
        encode(DecisionTree.split(2, 0.5, LEAF(0), LEAF(0)), codons, TABLES)


def test_refuses_a_genotype_that_is_too_short():
    tree = DecisionTree.split(0, 0.5, LEAF(0), LEAF(1))
    with pytest.raises(
        UnencodableTreeError, match="needs at least 6 codons; the genotype of 5 gives 5 with 0 wraps"
    ):
        encode(tree, np.zeros(5, np.int32), TABLES)


def test_deep_trees_need_no_recursion():
    n_splits = 1500
    node = np.arange(n_splits)
    leaves = np.full(n_splits + 1, -1)
    tree = DecisionTree(
        feature=np.append(node % 2, leaves),
        threshold=np.append(np.full(n_splits, 0.5), leaves + 1),
        children_left=np.append(node + 1, leaves),
        children_right=np.append(2 * n_splits - node, leaves),
        action=np.append(np.full(n_splits, -1), leaves + 1),
    )
    codons = np.zeros(5 * n_splits + 1, np.int32)
    assert mapped(encode(tree, codons, TABLES), TABLES) == snap(tree, GRAMMAR)


def test_the_given_genotype_stays_as_it_is():
    codons = np.zeros(20, np.int32)
    encode(DecisionTree.split(1, 0.5, LEAF(1), LEAF(2)), codons, TABLES)
    assert not codons.any()


@given(st.data())
def test_what_the_mapping_gave_can_be_derived_again(data):
    _, tree = data.draw(mapped_genotypes(TABLES, 0))
    assert can_derive(tree, TABLES)
    assert can_derive(replace(tree, threshold=np.where(tree.is_leaf, 0, tree.threshold + 0.001)), TABLES)


def test_what_the_grammar_cannot_say_cannot_be_derived():
    text = "<dt> ::= if lt(x, [0, 1] step 0.5) then left else <a> <a> ::= left | right"
    tables = compile_rules(read_grammar(text, ("x", "y"), ("left", "right")), single_choice_consumes=False)
    assert can_derive(DecisionTree.split(0, 0.4, LEAF(0), LEAF(1)), tables)
    assert not can_derive(DecisionTree.split(1, 0.4, LEAF(0), LEAF(1)), tables), "it never tests y"
    assert not can_derive(DecisionTree.split(0, 0.4, LEAF(1), LEAF(0)), tables), "it never goes right first"
    assert not can_derive(LEAF(0), tables)
