"""Law 2: `map(encode(tree, codons)) == snap(tree)`, snapping is idempotent, and codons that are not read stay."""

from __future__ import annotations

import numpy as np
import pytest
from grammars_for_tests import ACTIONS, FEATURES, cartpole_like, genotypes, grammars
from hypothesis import assume, given
from hypothesis import strategies as st
from reference_mapper import ReferenceMapper
from strategies import trees

from ge_torchrl.errors import UnencodableTreeError
from ge_torchrl.ge.codons import CODON_LIMIT
from ge_torchrl.ge.encoding import can_derive, constants_near, encode, snap
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.ge.operators import random_population
from ge_torchrl.ge.rule_tables import compile_rules
from ge_torchrl.trees.tree import DecisionTree

GRAMMAR = cartpole_like()
TABLES = compile_rules(GRAMMAR)
leaf, split = DecisionTree.leaf, DecisionTree.split


def mapped(codons, tables, wraps=0):
    forest = map_population(codons[np.newaxis], tables, wraps)
    return forest.tree(0) if forest.valid[0] else None


@st.composite
def mapped_genotypes(draw, tables, wraps):
    """A genotype that maps to a tree, and the tree."""
    codons = random_population(
        60, draw(st.integers(1, 60)), np.random.default_rng(draw(st.integers(0, 2**32)))
    )
    forest = map_population(codons, tables, wraps)
    assume(forest.valid.any())
    chosen = draw(st.sampled_from(np.flatnonzero(forest.valid).tolist()))
    return codons[chosen], forest.tree(chosen)


def altered(tree, draw):
    """The same structure with other thresholds, and here and there another feature or action."""
    n_splits = tree.num_decision_nodes
    return DecisionTree.axis_aligned(
        feature=[draw(st.sampled_from([f, 0, 1])) for f in tree.feature],
        threshold=draw(st.lists(st.floats(-1.5, 1.5), min_size=n_splits, max_size=n_splits)),
        children_left=tree.children_left,
        children_right=tree.children_right,
        action=[draw(st.sampled_from([a, a, 0, 1, 2])) for a in tree.action],
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


@given(trees(2, 3), genotypes(1))
def test_every_tree_with_a_split_comes_back_from_any_genotype(tree, codon):
    assume(tree.num_decision_nodes > 0)
    encoded = encode(tree, np.repeat(codon, 200), TABLES)
    assert mapped(encoded, TABLES) == snap(tree, GRAMMAR)
    assert ((encoded >= 0) & (encoded < CODON_LIMIT)).all()


@given(st.data(), grammars(), genotypes(20), st.integers(0, 2))
def test_what_a_grammar_derived_it_derives_again_from_another_genotype(data, grammar, others, wraps):
    tables = compile_rules(grammar)
    codons, tree = data.draw(mapped_genotypes(tables, wraps))
    assert (encode(tree, codons, tables, wraps) == codons).all()
    reference = ReferenceMapper(grammar, codons, wraps)
    reference.tree()
    enough = np.resize(others, max(reference.read, 1))
    assert mapped(encode(tree, enough, tables), tables) == tree


@given(st.data(), grammars(), st.integers(0, 2))
def test_an_encoded_tree_comes_back_or_there_is_an_error(data, grammar, wraps):
    tables = compile_rules(grammar)
    codons, tree = data.draw(mapped_genotypes(tables, wraps))
    target = altered(tree, data.draw)
    try:
        encoded = encode(target, codons, tables, wraps)
    except UnencodableTreeError:
        return
    assert mapped(encoded, tables, wraps) == snap(target, grammar)


@given(st.data(), grammars(), genotypes(12))
def test_codons_that_the_mapping_does_not_read_stay(data, grammar, tail):
    tables = compile_rules(grammar)
    codons, tree = data.draw(mapped_genotypes(tables, 0))
    try:
        encoded = encode(altered(tree, data.draw), np.append(codons, tail), tables)
    except UnencodableTreeError:
        return
    reference = ReferenceMapper(grammar, encoded)
    reference.tree()
    np.testing.assert_array_equal(encoded[reference.read :], np.append(codons, tail)[reference.read :])


@given(trees(2, 3))
def test_snap_is_idempotent_and_changes_thresholds_only(tree):
    snapped = snap(tree, GRAMMAR)
    assert snap(snapped, GRAMMAR) == snapped
    assert snapped.structure == tree.structure
    observations = np.random.default_rng(0).choice([-5.0, 5.0], size=(64, 2))
    clipped = tree.with_parameters(np.clip(tree.parameters, -1, 1))
    np.testing.assert_array_equal(snapped.decide(observations), clipped.decide(observations))


def test_snap_takes_the_nearest_constant_of_the_nodes_own_feature():
    text = """<t> ::= a0 | if <c> then <t> else <t>
    <c> ::= lt(f0, [0, 10] step 5) | lt(f1, 2) | lt(f1, [-1, 1] step 0.5)"""
    grammar = read_grammar(text, FEATURES, ACTIONS)
    tree = split(0, 2.6, split(1, 1.6, leaf(0), leaf(0)), leaf(0))
    assert snap(tree, grammar).threshold.tolist() == [5, 2]
    lower = split(0, 2.5, split(1, 1.5, leaf(0), leaf(0)), leaf(0))
    assert snap(lower, grammar).threshold.tolist() == [0, 1]


def test_only_the_codons_of_what_changed_change():
    #                  f1  -0.75 if f0  0.25  leaf a2 leaf a1  leaf a0  unread
    codons = np.array([1, 1000, 1, 2, 904, 10, 500, 2, 400, 8, 9, 77, 78], np.int32)
    tree = mapped(codons, TABLES)
    target = tree.with_parameters([tree.threshold[0], 0.6]).with_actions([2, 2, 0])
    encoded = encode(target, codons, TABLES)
    # 0.5 is constant 6 of the range: 904 - 904 % 9 + 6. The action is 2: 400 - 400 % 3 + 2.
    assert encoded.tolist() == [1, 1000, 1, 2, 906, 10, 500, 2, 401, 8, 9, 77, 78]


def test_a_codon_at_the_limit_changes_downwards():
    grammar = read_grammar("<t> ::= a0 | a1 | a2", FEATURES, ACTIONS)
    tables = compile_rules(grammar)
    top = CODON_LIMIT - 1  # Its remainder by 3 is 0, the last before the limit.
    assert encode(leaf(2), np.array([top], np.int32), tables).tolist() == [top - 1]


def test_of_two_derivations_one_that_fits_the_genotype_is_taken():
    text = "<t> ::= <long> | a0\n<long> ::= <longer> | a1\n<longer> ::= a0 | a2"
    tables = compile_rules(read_grammar(text, FEATURES, ACTIONS))
    # Codon 0 chooses <long>, from which a0 takes three codons.
    assert encode(leaf(0), np.array([0, 0, 0], np.int32), tables).tolist() == [0, 0, 0]
    assert encode(leaf(0), np.array([0, 0], np.int32), tables).tolist() == [1, 0]


def test_one_codon_serves_two_readings_where_their_choices_agree():
    text = "<t> ::= if lt(f0, [0, 2] step 1) then <a> else a0\n<a> ::= a0 | a1"
    tables = compile_rules(read_grammar(text, FEATURES, ACTIONS))
    tree = split(0, 2, leaf(1), leaf(0))
    encoded = encode(tree, np.array([0], np.int32), tables, wraps=1)
    assert encoded.tolist() == [5]  # 5 % 3 = 2 and 5 % 2 = 1.
    assert mapped(encoded, tables, 1) == tree


def test_one_codon_cannot_serve_two_choices_that_exclude_each_other():
    text = "<t> ::= if lt(f0, 1) then <a> else <a>\n<a> ::= a0 | a1"
    tables = compile_rules(read_grammar(text, FEATURES, ACTIONS))
    with pytest.raises(UnencodableTreeError, match="codon 0 is read again after a wrap"):
        encode(split(0, 1, leaf(0), leaf(1)), np.array([0], np.int32), tables, wraps=1)


def test_refuses_what_the_grammar_cannot_derive():
    codons = np.zeros(50, np.int32)
    with pytest.raises(UnencodableTreeError, match="gives this tree of 0 decision nodes"):
        encode(leaf(0), codons, TABLES)
    with pytest.raises(UnencodableTreeError, match="no derivation"):
        encode(split(0, 0.5, leaf(0), leaf(3)), codons, TABLES)
    with pytest.raises(UnencodableTreeError, match="split 0 tests feature number 2"):
        encode(split(2, 0.5, leaf(0), leaf(0)), codons, TABLES)


def test_refuses_a_genotype_that_is_too_short():
    tree = split(0, 0.5, leaf(0), leaf(1))
    with pytest.raises(
        UnencodableTreeError, match="needs at least 6 codons; the genotype of 5 gives 5 with 0 wraps"
    ):
        encode(tree, np.zeros(5, np.int32), TABLES)


def test_refuses_trees_that_a_grammar_cannot_say():
    weighted = DecisionTree.weighted_split([0, 1], [1.0, 2.0], 0.5, leaf(0), leaf(1))
    for tree, reason in (
        (weighted, r"split 0 tests the sum f0 \+ f1, which no condition"),
        (
            DecisionTree.value_leaf([0.5]),
            "a leaf holds an action in a tree of the grammar, and 1 value in this",
        ),
    ):
        with pytest.raises(UnencodableTreeError, match=reason):
            encode(tree, np.zeros(50, np.int32), TABLES)
        assert not can_derive(tree, TABLES)


def test_deep_trees_need_no_recursion():
    n_splits = 1500
    number = np.arange(n_splits)
    tree = DecisionTree.axis_aligned(
        feature=number % 2,
        threshold=np.full(n_splits, 0.5),
        children_left=np.append(number[1:], ~0),
        children_right=~(n_splits - number),
        action=np.zeros(n_splits + 1, int),
    )
    codons = np.zeros(5 * n_splits + 1, np.int32)
    assert mapped(encode(tree, codons, TABLES), TABLES) == snap(tree, GRAMMAR)


def test_the_given_genotype_stays_as_it_is():
    codons = np.zeros(20, np.int32)
    encode(split(1, 0.5, leaf(1), leaf(2)), codons, TABLES)
    assert not codons.any()


@given(st.data())
def test_what_the_mapping_gave_can_be_derived_again(data):
    _, tree = data.draw(mapped_genotypes(TABLES, 0))
    assert can_derive(tree, TABLES)
    assert can_derive(tree.with_parameters(tree.parameters + 0.001), TABLES)


def test_what_the_grammar_cannot_say_cannot_be_derived():
    text = "<dt> ::= if lt(x, [0, 1] step 0.5) then left else <a> <a> ::= left | right"
    tables = compile_rules(read_grammar(text, ("x", "y"), ("left", "right")))
    assert can_derive(split(0, 0.4, leaf(0), leaf(1)), tables)
    assert not can_derive(split(1, 0.4, leaf(0), leaf(1)), tables), "it never tests y"
    assert not can_derive(split(0, 0.4, leaf(1), leaf(0)), tables), "it never goes right first"
    assert not can_derive(leaf(0), tables)


NEAR = read_grammar(
    """
    <if>     ::= if <test> then <action> else <action>
    <test>   ::= lt(a, [-1, 1] step 0.1) | lt(b, [0, 100] step 10) | lt(b, [0, 3] step 1)
    <action> ::= left | right | <if>
    """,
    ("a", "b", "c"),
    ("left", "right"),
)


def test_constants_near_move_one_threshold_by_some_constants():
    tree = snap(split(0, 0.0, leaf(0), split(1, 50.0, leaf(1), leaf(0))), NEAR)
    near = constants_near(tree, NEAR, strides=(-1, 2))
    assert near.dtype == np.float32
    np.testing.assert_allclose(near, [[-0.1, 50], [0.2, 50], [0, 40], [0, 70]], rtol=1e-6)
    assert len(constants_near(tree, NEAR)) == 12


def test_constants_near_end_where_the_range_does():
    assert constants_near(split(1, 90.0, leaf(0), leaf(1)), NEAR, (-1, 1, 2)).tolist() == [[80], [100]]
    # 0 is the first constant of two ranges.
    near = constants_near(split(1, 0.0, leaf(0), leaf(1)), NEAR, (-1, 1, 3))
    assert near.tolist() == [[10], [30], [1], [3]]


def test_what_is_no_constant_or_never_tested_does_not_move():
    for tree in (leaf(0), split(0, 0.123, leaf(0), leaf(1)), split(2, 0.0, leaf(0), leaf(1))):
        assert constants_near(tree, NEAR).shape == (0, tree.num_decision_nodes)


@given(trees(2, 3))
def test_constants_near_are_constants_and_differ_in_one_threshold(tree):
    snapped = snap(tree, GRAMMAR)
    for parameters in constants_near(snapped, GRAMMAR):
        assert (parameters != snapped.parameters).sum() == 1
        moved = snapped.with_parameters(parameters)
        assert snap(moved, GRAMMAR) == moved
