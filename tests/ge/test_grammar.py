import math

import numpy as np
import pytest
from grammars_for_tests import ACTIONS, CARTPOLE, FEATURES, cartpole_like

from ge_torchrl.errors import GrammarError
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.productions import Action, Constants, Feature, If, Kind, LessThan, Nonterminal, Place

HERE = Place(1, 1)


def constants_of(text):
    grammar = read_grammar(f"<a> ::= if lt(f0, {text}) then a0 else a1", FEATURES, ACTIONS)
    (constants,) = grammar.constants[0]
    return constants


@pytest.mark.parametrize(
    ("text", "most"),
    [
        ("<t> ::= a0 | a1", 0),
        ("<t> ::= if lt(f0, 0) then a0 else a1", 1),
        (
            "<t> ::= if <c> then <u> else <u>\n<u> ::= a0 | if <c> then a0 else a1\n<c> ::= lt(f0, 0) | lt(f1, 0)",
            3,
        ),
        ("<t> ::= a0 | if lt(f0, 0) then if lt(f1, 0) then a0 else a1 else if lt(f1, 1) then a2 else a1", 3),
        ("<t> ::= a0 | if lt(f0, 0) then <t> else a1", math.inf),
        ("<t> ::= if lt(f0, 0) then <u> else a1\n<u> ::= a0 | if lt(f1, 0) then <u> else <u>", math.inf),
        # Sums that hold sums make no tree larger.
        ("<t> ::= if lt(<s>, 0) then a0 else a1\n<s> ::= f0 | 2 * f1 + <s>", 1),
    ],
)
def test_the_most_splits_of_a_tree_are_known(text, most):
    assert read_grammar(text, FEATURES, ACTIONS).most_splits == most


def test_reads_terms_nested_in_one_line():
    grammar = read_grammar("<t> ::= if lt(f1, 0.5) then a0 else <t> | a2", FEATURES, ACTIONS)
    half = Constants(5, 1, 10, 1, place=HERE)
    condition = LessThan(Feature(1, place=HERE), half, place=HERE)
    split = If(condition, Action(0, place=HERE), Nonterminal("t", place=HERE), place=HERE)
    assert grammar.start.productions == (split, Action(2, place=HERE))


def test_knows_what_each_rule_derives():
    assert cartpole_like().kinds == {
        "dt": Kind.TREE,
        "if": Kind.TREE,
        "condition": Kind.CONDITION,
        "action": Kind.TREE,
        "leaf": Kind.TREE,
        "constant": Kind.CONSTANT,
    }


def test_comments_and_line_ends_only_separate():
    one_line = read_grammar("<t> ::= if <c> then a0 else a1 | a2 <c> ::= lt(f0, 0)", FEATURES, ACTIONS)
    many = "# first\n<t> ::= if <c>  # inside\n then a0\r\n else a1\n\n | a2\n<c> ::=\n lt(f0,\n 0)# last"
    assert read_grammar(many, FEATURES, ACTIONS) == one_line


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("[-4.8, 4.8] step 0.005", [-4.8 + 0.005 * i for i in range(1921)]),
        ("[-28.27, 28.27] step 0.001", [-28.27 + 0.001 * i for i in range(56541)]),
        ("[0, 1] step 0.3", [0, 0.3, 0.6, 0.9]),
        ("[0.25, 0.25] step 7", [0.25]),
        ("[-.5, +.5] step 1", [-0.5, 0.5]),
        ("-0.0", [0]),
        ("0.1", [0.1]),
    ],
)
def test_values_are_the_decimals_in_float32(text, values):
    constants = constants_of(text)
    read = np.array([constants.value(i) for i in range(constants.count)])
    assert constants.count == len(values)
    # The naive sums on the right are off by far less than float32 resolves, but 0 would be missed.
    np.testing.assert_allclose(read, values, rtol=1e-7, atol=1e-12)
    assert (read == read.astype(np.float32)).all()


@pytest.mark.parametrize(("low", "step", "index"), [("-4.8", "0.005", 960), ("-28.27", "0.001", 28270)])
def test_zero_is_zero_and_decimals_are_correctly_rounded(low, step, index):
    constants = constants_of(f"[{low}, 30] step {step}")
    assert constants.value(index) == 0
    assert not np.signbit(constants.value(index))
    assert constants.value(index + 3 * constants.scale // constants.step // 10) == float(np.float32(0.3))


def test_nearest_constant_takes_the_lower_of_two_equally_near():
    constants = constants_of("[-1, 1] step 0.5")
    thresholds = [-9, -0.76, -0.75, -0.74, 0, 0.25, 0.26, 9]
    assert [constants.value(constants.nearest(t)) for t in thresholds] == [-1, -1, -1, -0.5, 0, 0, 0.5, 1]
    assert constants.find(0.5) == 3
    assert constants.find(0.4) is None


def test_collects_the_constants_offered_with_each_feature_through_rules():
    text = """<t> ::= if <c> then a0 else a1
    <c> ::= lt(<any>, <k>) | lt(f1, [0, 1] step 1)
    <any> ::= <zero> | f1
    <zero> ::= f0
    <k> ::= 3 | [5, 6] step 1"""
    grammar = read_grammar(text, ["f0", "f1", "f2"], ACTIONS)
    offered = [sorted(c.value(0) for c in constants) for constants in grammar.constants]
    assert offered == [[3, 5], [0, 3, 5], []]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1, column 1: .*the text is empty"),
        ("  # nothing\n", "line 2, column 1: .*the text is empty"),
        ("a0", "line 1, column 1: expected a rule's beginning"),
        ("<t> ::= a0 a1", "line 1, column 12: expected `[|]` or a new rule, found `a1`"),
        ("<t> ::=", "line 1, column 8: expected an action, .*found the end of the text"),
        ("<t> ::= a0 |\n<u> ::= a1", "line 2, column 1: expected an action"),
        ("<t> ::= a0 ; a1", "line 1, column 12: unexpected character ';'"),
        ("<t> ::= if lt(f0, 1) a0 else a1", "line 1, column 22: expected `then`, found `a0`"),
        ("<t> ::= if lt(f0 1) then a0 else a1", "line 1, column 18: expected `,`, found `1`"),
        ("<t> ::= if lt(f0, [0, 1]) then a0 else a1", "line 1, column 25: expected `step`"),
        ("<t> ::= if lt(f0, [0, x] step 1) then a0 else a1", "column 23: expected a number, the upper end"),
        ("<t> ::= a0 | step", "line 1, column 14: unknown name `step`"),
        ("<t> ::= a0\n  | left", "line 2, column 5: unknown name `left`; .*are f0, f1 .*are a0, a1, a2"),
        ("<t> ::= a0 | <u>", "line 1, column 14: <u> has no rule; the rules are <t>"),
        ("<t> ::= a0\n<t> ::= a1", "line 2, column 1: <t> has a rule already, at line 1, column 1"),
        ("<t> ::= a0\n<u> ::= a1", "line 2, column 1: <u> is never used"),
        ("<t> ::= <t> | a0", "line 1, column 1: <t> derives itself .*: <t> -> <t>"),
        ("<t> ::= a0 | <u>\n<u> ::= a1 | <t>", "derives itself .*: (<t> -> <u> -> <t>|<u> -> <t> -> <u>)"),
        ("<t> ::= if lt(f0, 1) then <t> else a0", "line 1, column 1: <t> never ends"),
        ("<t> ::= a0 | <u>\n<u> ::= if lt(f0, 1) then <u> else <t>", "line 2, column 1: <u> never ends"),
        ("<t> ::= a0 | f0", "line 1, column 14: .*the first is a tree, this one is a feature"),
        ("<t> ::= a0 | <k>\n<k> ::= 1", "line 1, column 14: .*this one is a constant"),
        (
            "<t> ::= if f0 then a0 else a1",
            "line 1, column 12: expected a condition here, but this is a feature",
        ),
        ("<t> ::= if lt(a0, 1) then a0 else a1", "column 15: expected a feature or a sum of features here"),
        ("<t> ::= if lt(f0, f1) then a0 else a1", "column 19: expected a constant here"),
        ("<t> ::= if lt(f0, 1) then 1 else a1", "column 27: expected a tree here, but this is a constant"),
        ("<c> ::= lt(f0, 1)", "line 1, column 1: the first rule must derive a tree, but <c> is a condition"),
        ("<t> ::= if lt(f0, [1, 0] step 1) then a0 else a1", "column 19: the range is empty: `1` is greater"),
        ("<t> ::= if lt(f0, [0, 1] step 0) then a0 else a1", "column 31: the step .* positive, got `0`"),
        ("<t> ::= if lt(f0, [0, 1] step -1) then a0 else a1", "column 31: the step .* positive, got `-1`"),
        ("<t> ::= if lt(f0, [0, 9] step 0.000000001) then a0 else a1", "column 19: the range is too fine"),
        ("<t> ::= if lt(f0, [1234567890, 1234567890] step 0.0000001) then a0 else a1", "too fine"),
        ("<t> ::= if lt(f0, 1234567890.123456) then a0 else a1", "column 19: a number may have 15 digits"),
        ("<t> ::= " + "if lt(f0, 1) then a0 else " * 60 + "a0", "column 1286: .*deeper than 50 levels"),
    ],
)
def test_refuses_and_says_where(text, message):
    with pytest.raises(GrammarError, match=message):
        read_grammar(text, FEATURES, ACTIONS)


@pytest.mark.parametrize(
    ("features", "actions", "message"),
    [
        (["x", "up"], ["up", "down"], "'up' comes twice"),
        (["x", "x"], ["up"], "'x' comes twice"),
        (["x y"], ["up"], "got 'x y'"),
        (["x"], ["then"], "got 'then'"),
    ],
)
def test_refuses_names_that_cannot_be_words(features, actions, message):
    with pytest.raises(GrammarError, match=message):
        read_grammar("<t> ::= up", features, actions)


def test_a_long_chain_of_rules_needs_no_recursion():
    chain = "\n".join(f"<t{i}> ::= <t{i + 1}> | a0" for i in range(990)) + "\n<t990> ::= a1"
    assert read_grammar(chain, FEATURES, ACTIONS).kinds["t0"] is Kind.TREE


def test_the_text_of_the_thesis_is_read():
    assert list(read_grammar(CARTPOLE, FEATURES, ACTIONS).rules) == [
        "dt",
        "if",
        "condition",
        "action",
        "leaf",
        "constant",
    ]
