"""Grammars made for environments that bring none."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ge_torchrl.errors import GrammarError
from ge_torchrl.ge.generating import choose_grammar, grammar_text
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.ge.rule_tables import compile_rules

NAMES = ["x", "y", "act", "x_dot", "dt", "sum", "term", "_", "leaf", "Theta1"]
INFINITE = (-math.inf, math.inf)


def ends():
    scale = st.sampled_from([1e-6, 1e-3, 1.0, 7.3, 1e3, 1e6])
    return st.builds(lambda number, by: number * by, st.floats(-3, 3), scale)


def ranges():
    degenerate = ends().map(lambda end: (end, end))
    return st.tuples(ends(), ends()).map(lambda pair: tuple(sorted(pair))) | degenerate


@given(st.data(), st.sampled_from(["axis", "oblique"]), st.sampled_from(["action", "constant", "linear"]))
def test_every_generated_text_is_read_back(data, splits, leaves):
    features = data.draw(st.lists(st.sampled_from(NAMES), min_size=1, max_size=5, unique=True))
    found = data.draw(st.lists(ranges(), min_size=len(features), max_size=len(features)))
    binary = {name for name, pair in zip(features, found, strict=True) if pair == (0, 1)}
    continuous = leaves != "action"
    actions = data.draw(
        st.lists(st.sampled_from(["left", "x", "a b", "force"]), min_size=1, max_size=3, unique=True)
        if continuous
        else st.just(["left", "right"])
    )
    bound = ranges() | st.sampled_from([INFINITE, (-math.inf, 2.0), (0.5, math.inf), (-1.0, 1.0)])
    bounds = data.draw(st.lists(bound, min_size=len(actions), max_size=len(actions))) if continuous else ()
    text = grammar_text(features, actions, found, splits, leaves, bounds, binary=binary)
    grammar = read_grammar(text, features, actions, continuous=continuous)
    tables = compile_rules(grammar)
    assert map_population(np.zeros((1, 40), np.int32), tables).arrays.leaf_start[0] == 0
    varying = [of for of, constants in enumerate(grammar.constants) if constants]
    assert grammar.splits == ("oblique" if splits == "oblique" and len(varying) > 1 else "axis")
    if leaves != "linear" or not varying:
        assert grammar.leaves in ("action", "constant")
    for of in varying:
        (constants,) = grammar.constants[of]
        low, high = found[of]
        spacing = max(abs(low), abs(high)) * 3e-7
        assert constants.value(0) <= low + spacing
        assert constants.value(constants.count - 1) >= high - spacing
        assert 2 <= constants.count <= 2100
        assert low >= 0 or high <= 0 or constants.find(0.0) is not None
    for entries in grammar.leaf_offers:
        for (low, high), entry in zip(bounds, entries, strict=True):
            for constants in entry.alone:
                slack = 1e-6 * max(
                    1e-6, abs(low) if math.isfinite(low) else 0, abs(high) if math.isfinite(high) else 0
                )
                assert low - slack <= constants.value(0)
                assert constants.value(constants.count - 1) <= high + slack


def test_the_text_of_an_oblique_grammar():
    text = grammar_text(
        ["x", "theta", "leg"],
        ["left", "right"],
        [(-2.4, 2.4), (-0.21, 0.21), (0, 1)],
        "oblique",
        "action",
        binary=["leg"],
    )
    assert (
        text
        == """\
<dt>        ::= <if>
<if>        ::= if <condition> then <action> else <action>
<condition> ::= <single> | <oblique>
<single>    ::= lt(x, [-2.4, 2.4] step 0.01)
              | lt(theta, [-0.21, 0.21] step 0.001)
              | lt(leg, 0.5)
<oblique>   ::= lt(<sum>, [-4, 4] step 0.01)
<sum>       ::= <term> + <term> | <term> + <sum>
<term>      ::= [-0.2, 0.2] step 0.002 * x
              | [-2, 2] step 0.02 * theta
              | [-2, 2] step 0.02 * leg
<action>    ::= <leaf> | <if>
<leaf>      ::= left | right
"""
    )


def test_the_text_of_linear_leaves():
    text = grammar_text(["cos", "v"], ["torque"], [(-1, 1), (-8, 8)], "axis", "linear", [(-2, 2)])
    assert (
        text
        == """\
<dt>           ::= <leaf> | if <condition> then <dt> else <dt>
<condition>    ::= lt(cos, [-1, 1] step 0.005) | lt(v, [-8, 8] step 0.02)
<torque-value> ::= [-2, 2] step 0.01 | [-20, 20] step 0.1 + <torque-sum>
<torque-sum>   ::= <torque-term> | <torque-term> + <torque-sum>
<torque-term>  ::= [-20, 20] step 0.2 * cos | [-2, 2] step 0.02 * v
<leaf>         ::= act(<torque-value>)
"""
    )


def test_weights_make_terms_of_comparable_size():
    pairs = [(-1e-6, 1e-6), (0, 2e6), (-3, 1)]
    text = grammar_text(["a", "b", "c"], ["u"], pairs, "oblique", "linear", [(-5, 5)])
    grammar = read_grammar(text, ["a", "b", "c"], ["u"], continuous=True)
    for offer in (grammar.split_offers[-1].linear, grammar.leaf_offers[0][0].linear):
        effects = []
        for of, (low, high) in enumerate(pairs):
            (weights,) = offer.weights[of]
            assert weights.count == 201
            effects.append(weights.value(200) * (high - low))
        assert max(effects) / min(effects) < 2.6


def test_a_feature_that_does_not_vary_is_left_out():
    text = grammar_text(["x", "still"], ["left", "right"], [(-1, 1), (3, 3)], "oblique", "action")
    assert "still" not in text
    assert grammar_text(["still"], ["left", "right"], [(3, 3)], "axis", "action") == (
        "<dt>   ::= <leaf>\n<leaf> ::= left | right\n"
    )


def test_infinite_bounds_have_a_stated_default():
    text = grammar_text(
        ["x"], ["a", "b", "c"], [(0, 1)], "axis", "constant", [INFINITE, (3, math.inf), (-math.inf, 3)]
    )
    assert "act([-1, 1] step 0.005, [3, 5] step 0.005, [1, 3] step 0.005)" in text


def test_refuses_ranges_that_are_none():
    for pair in ((1, 0), (0, math.inf), (math.nan, 1)):
        with pytest.raises(GrammarError, match="the range of feature x must be two numbers"):
            grammar_text(["x"], ["left"], [pair], "axis", "action")
    with pytest.raises(GrammarError, match="a range for each feature, 2; got 1"):
        grammar_text(["x", "y"], ["left"], [(0, 1)], "axis", "action")


AXIS = "<dt> ::= if lt(x, [0, 1] step 0.1) then left else right"


def chosen(bnf, splits=None, leaves=None, bounds=()):
    actions = ["force"] if bounds else ["left", "right"]
    return choose_grammar(bnf, splits, leaves, ["x", "y"], actions, bounds, lambda: [(-1, 1), (-2, 2)])


def test_the_given_rules_are_taken_where_they_are_of_the_kind_asked_for():
    for splits, leaves in ((None, None), ("axis", None), (None, "action"), ("axis", "action")):
        grammar, text, is_generated = chosen(AXIS, splits, leaves)
        assert (text, is_generated, grammar.splits) == (AXIS, False, "axis")


def test_other_rules_are_made_where_another_kind_is_asked_for():
    grammar, text, is_generated = chosen(AXIS, "oblique")
    assert is_generated
    assert (grammar.splits, grammar.leaves) == ("oblique", "action")
    # What was made is of the kind asked for: a run that is repeated takes it as it is.
    assert chosen(text, "oblique") == (grammar, text, False)


def test_what_is_left_open_follows_the_actions():
    assert (chosen(None).grammar.splits, chosen(None).grammar.leaves) == ("axis", "action")
    assert chosen(None, bounds=[(-1, 1)]).grammar.leaves == "linear"
    assert chosen(None, "oblique", "constant", [(-1, 1)]).grammar.leaves == "constant"


def test_refuses_leaves_that_the_actions_cannot_be():
    with pytest.raises(
        GrammarError, match=r"must be action, since .* discrete; got 'linear'; type grammar.leaves=null"
    ):
        chosen(AXIS, leaves="linear")
    with pytest.raises(GrammarError, match=r"must be constant or linear, since .* numbers; got 'action'"):
        chosen(None, leaves="action", bounds=[(-1, 1)])
    with pytest.raises(
        GrammarError, match=r"grammar.bnf, line 1, column 41: .*the actions here are discrete"
    ):
        chosen("<dt> ::= if lt(x, [0, 1] step 0.1) then act(1) else right")
