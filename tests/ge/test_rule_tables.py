import pytest
from grammars_for_tests import ACTIONS, FEATURES, cartpole_like

from ge_torchrl.errors import GrammarError
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.productions import Kind
from ge_torchrl.ge.rule_tables import (
    ACTION,
    CHOICE,
    CONSTANT,
    END,
    FEATURE,
    IF,
    MAX_SYMBOLS,
    RANGE,
    compile_rules,
)


def symbols_of(text):
    tables = compile_rules(read_grammar(text, FEATURES, ACTIONS))
    return list(zip(tables.program.symbol_kind, tables.program.symbol_argument, strict=True))


def test_rules_without_a_choice_are_written_out_in_place():
    tables = compile_rules(cartpole_like())
    condition, leaf, action = range(3)
    assert tables.rule_kinds == (Kind.CONDITION, Kind.TREE, Kind.TREE)
    expected = [(IF, 0), (CHOICE, condition), (CHOICE, action), (CHOICE, action), (END, 0)]
    expected += [(FEATURE, 0), (RANGE, 0), (END, 0), (FEATURE, 1), (RANGE, 0), (END, 0)]
    expected += [(ACTION, 0), (END, 0), (ACTION, 1), (END, 0), (ACTION, 2), (END, 0)]
    expected += [
        (CHOICE, leaf),
        (END, 0),
        (IF, 0),
        (CHOICE, condition),
        (CHOICE, action),
        (CHOICE, action),
        (END, 0),
    ]
    assert list(zip(tables.program.symbol_kind, tables.program.symbol_argument, strict=True)) == expected
    assert tables.rule_bodies == ((5, 8), (11, 13, 15), (17, 19))
    assert tables.program.body_start.tolist() == [5, 8, 11, 13, 15, 17, 19]
    assert [constants.count for constants in tables.ranges] == [9]
    assert (tables.at_start.splits, tables.per_choice.splits) == (1, 1)


def test_a_single_choice_is_no_choice():
    text = "<t> ::= <u>\n<u> ::= if lt(f0, [2, 2] step 1) then a0 else a1"
    assert symbols_of(text) == [(IF, 0), (FEATURE, 0), (CONSTANT, 0), (ACTION, 0), (ACTION, 1), (END, 0)]


def test_a_rule_that_is_a_range_is_one_choice():
    symbols = symbols_of("<t> ::= a0 | if lt(f0, <k>) then a0 else a1\n<k> ::= [0, 1] step 1")
    expected = [CHOICE, END, ACTION, END, IF, FEATURE, RANGE, ACTION, ACTION, END]
    assert [kind for kind, _ in symbols] == expected


def test_the_largest_body_of_a_choice_bounds_a_tree():
    text = """<t> ::= if lt(f0, 0) then <u> else if lt(f0, 1) then a0 else a1
    <u> ::= a0 | if lt(f1, 0) then a0 else if lt(f1, 1) then a1 else if lt(f1, 2) then a2 else <u>"""
    tables = compile_rules(read_grammar(text, FEATURES, ACTIONS))
    assert (tables.at_start.splits, tables.per_choice.splits) == (2, 3)
    assert compile_rules(read_grammar("<t> ::= a0", FEATURES, ACTIONS)).per_choice.splits == 0


def test_rules_that_double_each_other_are_refused_before_they_fill_the_memory():
    doubling = [f"<t{i}> ::= if lt(f0, 0) then <t{i + 1}> else <t{i + 1}>" for i in range(60)]
    grammar = read_grammar("\n".join([*doubling, "<t60> ::= a0"]), FEATURES, ACTIONS)
    with pytest.raises(GrammarError, match=rf"line 1, column 1: .*<t0> has more than {MAX_SYMBOLS} parts"):
        compile_rules(grammar)
