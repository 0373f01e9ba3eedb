from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from grammars_for_tests import ACTIONS, FEATURES, cartpole_like, genotypes, grammars
from hypothesis import given
from hypothesis import strategies as st

from ge_torchrl.ge.codons import CODON_LIMIT
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.ge.productions import Action, Constants, Feature, If, LessThan, Nonterminal
from ge_torchrl.ge.rule_tables import compile_rules
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest


class OutOfCodonsError(Exception):
    pass


class ReferenceMapper:
    """The mapping as the textbook says it: a recursive walk over the grammar, one term at a time."""

    def __init__(self, grammar, codons, wraps, *, single_choice_consumes):
        self.grammar = grammar
        self.codons = [int(codon) for codon in codons] * (wraps + 1)
        self.single_choice_consumes = single_choice_consumes
        self.read = 0
        self.begun = 0
        self.first_codon = []

    def tree(self):
        start = self.grammar.start
        return self.derive(Nonterminal(start.name, place=start.place))

    def choose(self, n_choices):
        if n_choices == 1 and not self.single_choice_consumes:
            return 0
        if self.read == len(self.codons):
            raise OutOfCodonsError
        self.read += 1
        return self.codons[self.read - 1] % n_choices

    def derive(self, term):
        match term:
            case Nonterminal(name=name):
                productions = self.grammar.rules[name].productions
                alone = productions[0]
                is_a_range = len(productions) == 1 and isinstance(alone, Constants) and alone.is_range
                return self.derive(alone if is_a_range else productions[self.choose(len(productions))])
            case Action(index=action):
                self.first_codon.append(self.begun)
                self.begun = self.read
                return DecisionTree.leaf(action)
            case If():
                self.first_codon.append(self.begun)
                feature, threshold = self.derive(term.condition)
                self.begun = self.read
                left = self.derive(term.then)
                return DecisionTree.split(feature, threshold, left, self.derive(term.otherwise))
            case LessThan():
                feature = self.derive(term.feature)
                return feature, self.derive(term.constant)
            case Feature(index=feature):
                return feature
            case Constants():
                index = self.choose(term.count) if term.is_range else 0
                value = Fraction(term.low, term.scale) + index * Fraction(term.step, term.scale)
                return float(np.float32(float(value)))


@given(grammars(), st.lists(genotypes(), min_size=1, max_size=4), st.integers(0, 2), st.booleans())
def test_kernel_maps_as_the_reference_does(grammar, rows, wraps, consumes):
    length = min(map(len, rows))
    codons = np.stack([row[:length] for row in rows])
    mapping = map_population(codons, compile_rules(grammar, single_choice_consumes=consumes), wraps)
    for individual, genotype in enumerate(codons):
        reference = ReferenceMapper(grammar, genotype, wraps, single_choice_consumes=consumes)
        try:
            tree = reference.tree()
        except OutOfCodonsError:
            assert not mapping.valid[individual]
            assert mapping.forest.sizes[individual] == 0
            assert mapping.codons_read[individual] == length * (wraps + 1)
            continue
        assert mapping.valid[individual]
        assert mapping.forest.tree(individual) == tree
        assert mapping.codons_read[individual] == reference.read
        rows_of_tree = slice(*mapping.forest.offsets[individual : individual + 2])
        assert mapping.first_codon[rows_of_tree].tolist() == reference.first_codon


def test_golden_derivation():
    #         f1  -0.75 if  f0  0   leaf a2  leaf a1 leaf a0  unread
    codons = [1, 10, 1, 2, 4, 0, 5, 2, 4, 8, 9, 77, 78]
    mapping = map_population(
        np.array([codons], np.int32), compile_rules(cartpole_like(), single_choice_consumes=False)
    )
    assert mapping.forest.tree(0) == DecisionTree(
        feature=[1, 0, -1, -1, -1],
        threshold=[-0.75, 0, 0, 0, 0],
        children_left=[1, 2, -1, -1, -1],
        children_right=[4, 3, -1, -1, -1],
        action=[-1, -1, 2, 1, 0],
    )
    assert mapping.codons_read.tolist() == [11]
    assert mapping.first_codon.tolist() == [0, 2, 5, 7, 9]


def test_wrapping_begins_anew_at_the_first_codon():
    # f1, -0.5, leaf; and once more from the first: a1, leaf, a0.
    codons = np.array([[1, 2, 0]], np.int32)
    tables = compile_rules(cartpole_like(), single_choice_consumes=False)
    assert not map_population(codons, tables, wraps=0).valid[0]
    mapping = map_population(codons, tables, wraps=1)
    assert mapping.codons_read.tolist() == [6]
    assert mapping.forest.tree(0) == DecisionTree.split(1, -0.5, DecisionTree.leaf(1), DecisionTree.leaf(0))
    assert mapping.first_codon.tolist() == [0, 2, 4]


def test_invalid_individuals_leave_no_trace():
    endless = [0, 0, 1] * 4
    short = [0, 0, 0, 0, 0, 1, *[0] * 6]
    tables = compile_rules(cartpole_like(), single_choice_consumes=False)
    mapping = map_population(np.array([endless, short, endless, short], np.int32), tables)
    assert mapping.valid.tolist() == [False, True, False, True]
    assert mapping.forest.offsets.tolist() == [0, 0, 3, 3, 6]
    assert mapping.forest.tree(1) == mapping.forest.tree(3)
    assert mapping.codons_read.tolist() == [12, 6, 12, 6]


def test_a_buffer_that_is_too_small_grows():
    # Every tree is a chain of 170 splits: far more nodes than the buffer begins with.
    genotype = [0, 3] + [0, 2, 1, 0, 3] * 169 + [0, 1, 0, 2]
    codons = np.tile(np.array(genotype, np.int32), (40, 1))
    mapping = map_population(codons, compile_rules(cartpole_like(), single_choice_consumes=False))
    assert mapping.forest.sizes.tolist() == [341] * 40
    assert mapping.forest.tree(39) == mapping.forest.tree(0)
    assert mapping.forest.tree(0).depth == 170


@pytest.mark.parametrize("shape", [(0, 5), (1, 1), (3, 1)])
def test_small_shapes(shape):
    tables = compile_rules(read_grammar("<t> ::= a0 | a1", FEATURES, ACTIONS), single_choice_consumes=False)
    mapping = map_population(np.ones(shape, np.int32), tables)
    assert mapping.forest.action.tolist() == [1] * shape[0]
    assert len(mapping.forest) == shape[0]


def test_a_grammar_without_choices_reads_nothing():
    tables = compile_rules(read_grammar("<t> ::= a2", FEATURES, ACTIONS), single_choice_consumes=False)
    mapping = map_population(np.empty((2, 0), np.int32), tables)
    assert mapping.forest.action.tolist() == [2, 2]
    assert mapping.codons_read.tolist() == [0, 0]


def test_the_greatest_codon_of_the_greatest_range():
    text = f"<t> ::= if lt(f0, [0, {CODON_LIMIT - 1}] step 1) then a0 else a1"
    tables = compile_rules(read_grammar(text, FEATURES, ACTIONS), single_choice_consumes=False)
    mapping = map_population(np.array([[CODON_LIMIT - 1]], np.int32), tables)
    assert mapping.forest.threshold[0] == np.float32(CODON_LIMIT - 1)


def test_the_forest_owns_compact_arrays():
    forest = map_population(
        np.zeros((5, 12), np.int32), compile_rules(cartpole_like(), single_choice_consumes=False)
    ).forest
    assert isinstance(forest, Forest)
    for array in (
        forest.feature,
        forest.threshold,
        forest.children_left,
        forest.children_right,
        forest.action,
    ):
        assert array.base is None
        assert len(array) == forest.offsets[-1]
