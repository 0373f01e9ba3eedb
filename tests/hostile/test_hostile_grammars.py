"""Grammars that nobody would write: each is refused in one line, or maps any codons to trees or to none."""

import time

import numpy as np
import pytest
from grammars_for_tests import CARTPOLE, genotypes
from hypothesis import given, settings
from hypothesis import strategies as st

from ge_torchrl.errors import GrammarError
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.ge.rule_tables import compile_rules
from ge_torchrl.printing import LONGEST_MESSAGE
from ge_torchrl.trees.tree import DecisionTree

FEATURES, ACTIONS = ("f0", "f1"), ("a0", "a1", "a2")
WORDS = (
    "if", "then", "else", "lt", "act", "step", "f0", "f1", "a0", "a1", "nothing", "(", ")", "[", "]", ",", "|", "+",
    "*", "::=", "<dt> ::=", "<x> ::=", "<dt>", "<x>", "<condition>", "<constant>", "-1", "0.25", "9" * 16,
    "[-1, 1] step 0.25",
    "[1, 0] step 1", "[0, 1] step 0", "[0, 1] step 0.000000000000001", "lt(f0, 1)", "#", "\n", "\x1b[31m", "é", "-",
)  # fmt: skip
SUMS = """
<dt>   ::= if lt(<sum>, [-1, 1] step 0.5) then a0 else a1 | if <condition> then <dt> else a2
<sum>  ::= <term> | <term> + <sum>
<term> ::= [-4, 4] step 1 * f0 | [-2, 2] step 0.5 * f1 | f1
<condition> ::= lt(f0, [-1, 1] step 0.25)
"""
# In one run and in another one; together 10,000.
FEW, MANY = 150, 5000


@st.composite
def mutants(draw):
    """A sound grammar with some words taken out, doubled, or replaced."""
    words = draw(st.sampled_from([CARTPOLE, SUMS])).replace("(", " ( ").replace(")", " ) ").split(" ")
    for _ in range(draw(st.integers(1, 6))):
        place = draw(st.integers(0, len(words) - 1))
        words[place : place + draw(st.integers(0, 2))] = draw(st.lists(st.sampled_from(WORDS), max_size=2))
        words = words or [""]
    return " ".join(words)


TEXTS = st.one_of(st.text(max_size=60), st.lists(st.sampled_from(WORDS), max_size=40).map(" ".join))


def check(text, rows, wraps):
    try:
        tables = compile_rules(read_grammar(text, FEATURES, ACTIONS))
    except GrammarError as error:
        told = str(error)
    else:
        told = ""
    if told:
        assert told.isprintable()
        assert len(told) <= LONGEST_MESSAGE
        return
    length = min(map(len, rows))
    forest = map_population(np.stack([row[:length] for row in rows]), tables, wraps)
    for tree in np.flatnonzero(forest.valid):
        DecisionTree(**forest.tree(int(tree)).arrays._asdict())


ROWS = st.lists(genotypes(), min_size=1, max_size=3)


@pytest.mark.parametrize("number", [FEW, pytest.param(MANY, marks=pytest.mark.slow)])
@pytest.mark.parametrize("texts", [TEXTS, mutants()], ids=["any text", "a damaged grammar"])
def test_any_text_is_refused_or_a_grammar(texts, number, tried):
    n_tried = 0

    @settings(max_examples=number)
    @given(texts, ROWS, st.integers(0, 2))
    def each(text, rows, wraps):
        nonlocal n_tried
        check(text, rows, wraps)
        n_tried += 1

    each()
    tried("grammars and genotypes made by chance", n_tried, 0)


def of_rules(form, n, last):
    return "\n".join([form.format(i, i + 1) for i in range(n)] + [f"<r{n}> ::= {last}"])


@pytest.mark.parametrize(
    "text",
    [
        of_rules("<r{}> ::= <r{}>", 900, "if lt(f0, 0) then a0 else a1"),
        of_rules("<r{}> ::= <r{}> | a0", 900, "if lt(f0, 0) then a0 else a1"),
        of_rules("<r{}> ::= if lt(f0, 0) then a0 else <r{}>", 900, "a0"),
        of_rules("<r{}> ::= if lt(f0, 0) then <r{}> else <r0> | a1", 900, "a0"),
        of_rules("<r{0}> ::= if lt(f0, 0) then <r{1}> else <r{1}> | a1", 900, "a0"),
        "<dt> ::= " + " | ".join(["a0"] * 20_000),
    ],
)
def test_a_grammar_of_hundreds_of_rules_is_read_in_a_moment(text):
    began = time.process_time()
    grammar = read_grammar(text, FEATURES, ACTIONS)
    compile_rules(grammar)
    assert grammar.most_splits >= 0
    assert time.process_time() - began < 5


@pytest.mark.parametrize(
    "text",
    [
        of_rules("<r{}> ::= <r{}>", 10_000, "a0"),
        of_rules("<r{}> ::= <r{}>", 900, "<nothing>"),
        of_rules("<r{}> ::= <r{}>", 900, "<r0>"),
        of_rules("<r{0}> ::= if lt(f0, 0) then <r{1}> else <r{1}>", 50, "a0"),
        "<dt> ::= " + "a" * 1_000_000,
        "<dt> ::= " + "if lt(f0, 0) then " * 1000,
        "<dt> ::= a0 " * 2,
        "<" + "d" * 5_000_000 + "> ::= a0",
    ],
)
def test_a_grammar_without_measure_is_refused_in_one_line(text):
    with pytest.raises(GrammarError) as caught:
        compile_rules(read_grammar(text, FEATURES, ACTIONS))
    assert len(str(caught.value)) <= LONGEST_MESSAGE


def test_how_many_splits_a_tree_may_have():
    assert read_grammar(CARTPOLE, FEATURES, ACTIONS).most_splits == float("inf")
    assert (
        read_grammar(
            "<dt> ::= if lt(f0, 0) then <l> else <l>\n<l> ::= a0 | a1", FEATURES, ACTIONS
        ).most_splits
        == 1
    )
