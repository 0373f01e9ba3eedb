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


def symbols_of(text, *, single_choice_consumes):
    tables = compile_rules(
        read_grammar(text, FEATURES, ACTIONS), single_choice_consumes=single_choice_consumes
    )
    return list(zip(tables.program.symbol_kind, tables.program.symbol_argument, strict=True))


def test_rules_without_a_choice_are_written_out_in_place():
    tables = compile_rules(cartpole_like(), single_choice_consumes=False)
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
    assert tables.program.rule_choices.tolist() == [2, 3, 2]
    assert tables.program.body_start.tolist() == [5, 8, 11, 13, 15, 17, 19]
    assert tables.program.range_choices.tolist() == [9]
    assert (tables.nodes_at_start, tables.nodes_per_choice) == (1, 1)


def test_a_single_choice_is_a_choice_where_it_consumes():
    text = "<t> ::= <u>\n<u> ::= if lt(f0, [2, 2] step 1) then a0 else a1"
    split = [(IF, 0), (FEATURE, 0), (CONSTANT, 0), (ACTION, 0), (ACTION, 1), (END, 0)]
    assert symbols_of(text, single_choice_consumes=False) == split
    split[2] = (RANGE, 0)
    u, t = 0, 1
    assert symbols_of(text, single_choice_consumes=True) == [
        (CHOICE, t),
        (END, 0),
        *split,
        (CHOICE, u),
        (END, 0),
    ]


@pytest.mark.parametrize("consumes", [False, True])
def test_a_rule_that_is_a_range_is_one_choice(consumes):
    text = "<t> ::= a0 | if lt(f0, <k>) then a0 else a1\n<k> ::= [0, 1] step 1"
    symbols = symbols_of(text, single_choice_consumes=consumes)
    assert [kind for kind, _ in symbols] == [
        CHOICE,
        END,
        ACTION,
        END,
        IF,
        FEATURE,
        RANGE,
        ACTION,
        ACTION,
        END,
    ]


def test_rules_that_double_each_other_are_refused_before_they_fill_the_memory():
    doubling = [f"<t{i}> ::= if lt(f0, 0) then <t{i + 1}> else <t{i + 1}>" for i in range(60)]
    grammar = read_grammar("\n".join([*doubling, "<t60> ::= a0"]), FEATURES, ACTIONS)
    with pytest.raises(GrammarError, match=rf"line 1, column 1: .*<t0> has more than {MAX_SYMBOLS} parts"):
        compile_rules(grammar, single_choice_consumes=False)
    assert compile_rules(grammar, single_choice_consumes=True).nodes_per_choice == 1
