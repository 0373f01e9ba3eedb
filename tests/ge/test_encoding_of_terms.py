"""Law 2 for weighted sums and for values at leaves."""

from __future__ import annotations

import time

import numpy as np
import pytest
from grammars_for_tests import ACTIONS, FEATURES, genotypes
from hypothesis import assume, given
from hypothesis import strategies as st
from reference_mapper import ReferenceMapper
from strategies import value_trees, weighted_trees
from sum_grammars_for_tests import force_like, grammars_with_terms, patient, two_like

from ge_torchrl.errors import UnencodableTreeError
from ge_torchrl.ge.codons import CODON_LIMIT
from ge_torchrl.ge.encoding import can_derive, constants_near, encode, snap
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.ge.operators import random_population
from ge_torchrl.ge.rule_tables import compile_rules
from ge_torchrl.trees.tree import DecisionTree

GRAMMARS = {1: force_like(), 2: two_like()}
TABLES = {n_values: compile_rules(grammar) for n_values, grammar in GRAMMARS.items()}
leaf, value_leaf = DecisionTree.leaf, DecisionTree.value_leaf
OBLIQUE = """
<dt> ::= if lt(<linear>, [-1, 1] step 0.5) then <dt> else <dt> | a0 | a1 | a2
<linear> ::= <term> | <linear> + <term>
<term> ::= [-2, 2] step 0.5 * <feature> | <feature>
<feature> ::= f0 | f1
"""


def mapped(codons, tables, wraps=0):
    forest = map_population(codons[np.newaxis], tables, wraps)
    return forest.tree(0) if forest.valid[0] else None


def read(text, actions=("force",)):
    grammar = read_grammar(text, FEATURES, actions, continuous=actions is not ACTIONS)
    return grammar, compile_rules(grammar)


@st.composite
def mapped_genotypes(draw, tables, wraps):
    """A genotype that maps to a tree, and the tree."""
    codons = random_population(
        40, draw(st.integers(1, 60)), np.random.default_rng(draw(st.integers(0, 2**32)))
    )
    forest = map_population(codons, tables, wraps)
    assume(forest.valid.any())
    chosen = draw(st.sampled_from(np.flatnonzero(forest.valid).tolist()))
    return codons[chosen], forest.tree(chosen)


def altered(tree, draw):
    """The tree with other numbers, some of them a little and some far away."""
    n = len(tree.parameters)
    moves = draw(st.lists(st.sampled_from([0, 0, 0.01, -0.3, 1]) | st.floats(-9, 9), min_size=n, max_size=n))
    return tree.with_parameters(tree.parameters + np.float32(moves))


@given(st.data(), st.sampled_from([1, 2]), st.integers(0, 1))
def test_altered_trees_of_the_mapping_come_back(data, n_values, wraps):
    grammar, tables = GRAMMARS[n_values], TABLES[n_values]
    codons, tree = data.draw(mapped_genotypes(tables, wraps))
    target = altered(tree, data.draw)
    try:
        encoded = encode(target, np.append(codons, np.zeros(200, np.int32)), tables, wraps)
    except UnencodableTreeError:
        assert wraps == 1
        return
    assert mapped(encoded, tables, wraps) == snap(target, grammar)
    assert ((encoded >= 0) & (encoded < CODON_LIMIT)).all()


@given(st.data(), st.sampled_from([1, 2]), genotypes(1))
def test_every_tree_of_values_comes_back_from_any_genotype(data, n_values, codon):
    tree = data.draw(value_trees(2, n_values, max_leaves=4))
    grammar, tables = GRAMMARS[n_values], TABLES[n_values]
    assert can_derive(tree, tables)
    encoded = encode(tree, np.repeat(codon, 400), tables)
    assert mapped(encoded, tables) == snap(tree, grammar)


@given(weighted_trees(2, 3), genotypes(1))
def test_every_oblique_tree_comes_back_from_a_grammar_that_repeats_to_the_left(tree, codon):
    grammar, tables = read(OBLIQUE, ACTIONS)
    encoded = encode(tree, np.repeat(codon, 400), tables)
    assert mapped(encoded, tables) == snap(tree, grammar)


@patient
@given(st.data(), grammars_with_terms(), genotypes(20), st.integers(0, 2))
def test_what_a_grammar_derived_it_derives_again_from_another_genotype(data, grammar, others, wraps):
    tables = compile_rules(grammar)
    codons, tree = data.draw(mapped_genotypes(tables, wraps))
    assert snap(tree, grammar) == tree
    # Entries that share terms cannot say in which order each of them had its own.
    assume(grammar.n_values < 2 or can_derive(tree, tables))
    assert can_derive(tree, tables)
    if grammar.n_values < 2:
        assert (encode(tree, codons, tables, wraps) == codons).all()
    reference = ReferenceMapper(grammar, codons, wraps, tables.feature_rank)
    reference.tree()
    enough = np.resize(others, max(reference.read, 1))
    assert mapped(encode(tree, enough, tables), tables) == tree


@patient
@given(st.data(), grammars_with_terms(), genotypes(12), st.integers(0, 2))
def test_an_encoded_tree_comes_back_or_there_is_an_error(data, grammar, tail, wraps):
    tables = compile_rules(grammar)
    codons, tree = data.draw(mapped_genotypes(tables, wraps))
    target = altered(tree, data.draw)
    longer = np.append(codons, tail)
    try:
        encoded = encode(target, longer, tables, wraps)
    except UnencodableTreeError:
        return
    assert mapped(encoded, tables, wraps) == snap(target, grammar)
    reference = ReferenceMapper(grammar, encoded, wraps, tables.feature_rank)
    reference.tree()
    np.testing.assert_array_equal(encoded[reference.read :], longer[reference.read :])


@patient
@given(st.data(), grammars_with_terms())
def test_snap_is_idempotent_and_constants_near_are_constants(data, grammar):
    _, tree = data.draw(mapped_genotypes(compile_rules(grammar), 0))
    try:
        snapped = snap(altered(tree, data.draw), grammar)
    except UnencodableTreeError:
        return
    assert snap(snapped, grammar) == snapped
    for parameters in constants_near(snapped, grammar, (-1, 2)):
        assert (parameters != snapped.parameters).sum() == 1
        moved = snapped.with_parameters(parameters)
        assert snap(moved, grammar) == moved


def test_numbers_go_to_the_nearest_constants_of_their_place():
    tree = DecisionTree.weighted_split(
        [0, 1], [0.7, 9.0], 0.3, value_leaf([0.3], {1: [1.6]}), value_leaf([0.3])
    )
    snapped = snap(tree, GRAMMARS[1])
    assert snapped.weight.tolist() == [0.5, 4]
    assert snapped.threshold.tolist() == [0.25]
    # In front of a sum are fewer constants.
    assert snapped.value.tolist() == [[0.5], [0.25]]
    assert snapped.leaf_weight.tolist() == [[2]]


def test_a_lone_feature_stays_alone_and_another_weight_scales_its_threshold():
    leaves = value_leaf([0.0]), value_leaf([1.0])
    assert snap(DecisionTree.split(0, 0.8, *leaves), GRAMMARS[1]) == DecisionTree.split(0, 0.75, *leaves)
    grammar, tables = read("<t> ::= if lt(2 * f0, [-4, 4] step 0.5) then act(0) else act(1)")
    tree = DecisionTree.split(0, 0.8, *leaves)
    expected = DecisionTree.weighted_split([0], [2.0], 1.5, *leaves)
    assert snap(tree, grammar) == expected
    assert mapped(encode(tree, np.zeros(1, np.int32), tables), tables) == expected


def test_a_sum_goes_to_the_condition_whose_constants_are_nearest():
    text = """<t> ::= if <c> then a0 else a1
    <c> ::= lt([0, 1] step 0.5 * f0 + f1, [0, 1] step 0.1) | lt([5, 9] step 1 * f0 + f1, [50, 90] step 10)"""
    grammar, tables = read(text, ACTIONS)
    for weights, threshold, expected in (
        ((0.4, 1.0), 0.33, [0.5, 1, 0.3]),
        ((0.4, 1.0), 49.0, [5, 1, 50]),
        ((8.2, 1.3), 66.0, [6, 1, 50]),  # As a whole: 1.3 is more than the feature alone offers.
    ):
        tree = DecisionTree.weighted_split([0, 1], weights, threshold, leaf(0), leaf(1))
        snapped = snap(tree, grammar)
        np.testing.assert_allclose([*snapped.weight, *snapped.threshold], expected, rtol=1e-6)
        assert can_derive(tree, tables)


def test_no_weight_that_entries_share_moves_to_zero():
    """It would say that its entry has no such term, and then another stands in its place."""
    grammar, _ = read("<t> ::= act(f0 + [-1, 1] step 0.5 * f1, 0)", ("force", "brake"))
    tree = value_leaf([0.0, 0.0], {0: [1.0, 0.0], 1: [-0.5, 0.0]})
    near = constants_near(tree, grammar, (-1, 1, 2))
    assert near[:, 4].tolist() == [-1.0, 0.5]
    for parameters in near:
        moved = tree.with_parameters(parameters)
        assert snap(moved, grammar) == moved


def test_terms_of_weight_zero_fill_the_places_that_a_form_has():
    text = (
        "<t> ::= act([-1, 1] step 1 * f1 + [-1, 1] step 1 * f0, <k> + [0, 2] step 1 * f1 + f0) <k> ::= 0 | 1"
    )
    _, tables = read(text, ("force", "brake"))
    tree = value_leaf([0.0, 1.0], {1: [0.0, 2.0], 0: [-1.0, 1.0]})
    encoded = encode(tree, np.full(4, 100, np.int32), tables)
    assert encoded.tolist() == [100, 99, 101, 101]
    assert mapped(encoded, tables) == tree
    nothing = value_leaf([0.0, 0.0], {0: [0.0, 1.0]})
    assert mapped(encode(nothing, np.full(4, 100, np.int32), tables), tables) == nothing


def test_entries_without_a_feature_lose_it():
    grammar, tables = read("<t> ::= act(<w> * f0, <w> * f1) <w> ::= [-1, 1] step 0.5", ("force", "brake"))
    refined = value_leaf([0.1, 0.0], {0: [0.4, 0.2], 1: [-3.0, 0.9]})
    assert snap(refined, grammar) == value_leaf([0.0, 0.0], {0: [0.5, 0.0], 1: [0.0, 1.0]})
    assert can_derive(refined, tables)


def test_refuses_what_the_grammar_cannot_say_and_tells_why():
    codons = np.zeros(50, np.int32)
    grammar, tables = read("<t> ::= if lt(f0 + f1, [0, 1] step 0.1) then act(f0) else act([0, 1] step 0.1)")
    halves = value_leaf([0.0], {0: [1.0]}), value_leaf([0.5])
    for tree, reason in (
        (DecisionTree.split(0, 0.5, *halves), "split 0 tests feature f0, which no condition"),
        (
            DecisionTree.weighted_split([1, 1, 0], [1, 1, 1], 0, *halves),
            "split 0 tests the sum f1 [+] f1 [+] f0",
        ),
        (
            DecisionTree.weighted_split([1, 0], [1, 1], 0, *halves),
            "no derivation from <t> gives this tree of 1",
        ),
        (value_leaf([0.0], {1: [1.0]}), "the values of leaf 0 are of a form that no `act`"),
        (value_leaf([0.0, 1.0]), "a leaf holds 1 value in a tree of the grammar, and 2 values in this one"),
        (leaf(0), "a leaf holds 1 value in a tree of the grammar, and an action in this one"),
    ):
        with pytest.raises(UnencodableTreeError, match=reason):
            encode(tree, codons, tables)
        assert not can_derive(tree, tables)
    assert can_derive(DecisionTree.weighted_split([0, 1], [2, 1], 0, *halves), tables)
    assert constants_near(leaf(0), grammar).shape == (0, 0)


def test_long_sums_take_no_exponential_time():
    n_terms = 60
    for linear in (
        "<term> | <term> + <linear>",
        "<term> | <linear> + <term>",
        "<term> | <linear> + <linear>",
    ):
        text = f"<t> ::= act(<linear>) <linear> ::= {linear} <term> ::= f0 | [0, 9] step 1 * f1"
        _, tables = read(text)
        tree = value_leaf([0.0], {0: [1.0]})
        rows = [(number % 2, 1.0 + number % 2) for number in range(n_terms)]
        tree = DecisionTree(
            **tree.arrays._replace(
                leaf_term_start=[0, n_terms],
                leaf_feature=[feature for feature, _ in rows],
                leaf_weight=[[weight] for _, weight in rows],
            )._asdict()
        )
        assert mapped(encode(tree, np.zeros(400, np.int32), tables), tables) == tree


def test_an_answer_of_many_features_and_entries_takes_no_seconds():
    n_features, n_entries = 100, 8
    features = [f"x{i}" for i in range(n_features)]
    rules = [f"<dt> ::= act({', '.join(f'<v{entry}>' for entry in range(n_entries))})"]
    for entry in range(n_entries):
        terms = " | ".join(f"[-2, 2] step 0.5 * {name}" for name in features)
        rules += [
            f"<v{entry}> ::= [-1, 1] step 0.5 + <s{entry}>",
            f"<s{entry}> ::= <t{entry}> | <t{entry}> + <s{entry}>",
        ]
        rules.append(f"<t{entry}> ::= {terms}")
    grammar = read_grammar("\n".join(rules), features, [f"a{i}" for i in range(n_entries)], continuous=True)
    weights = np.resize(np.float32([0.5, -1.0, 0.0, 2.0]), (n_features, n_entries))
    tree = value_leaf([0.5] * n_entries, dict(enumerate(weights.tolist())))
    started = time.process_time()
    assert can_derive(tree, compile_rules(grammar))
    assert time.process_time() - started < 5
