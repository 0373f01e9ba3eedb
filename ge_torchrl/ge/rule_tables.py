"""A grammar as flat integer tables: the program that the mapping's kernel runs.

A production becomes a body, a sequence of symbols in the order of derivation. A symbol is a kind and an
argument; a `CHOICE` stands for a rule, whose bodies one codon chooses from, as a call stands for a routine.
Rules that take no codon are written out in place, so every `CHOICE` and every `RANGE` reads exactly one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import islice
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.ge.grammar import Grammar
from ge_torchrl.ge.grammar_checks import fail
from ge_torchrl.ge.productions import (
    Action,
    Constants,
    Feature,
    If,
    Kind,
    LessThan,
    Nonterminal,
    Production,
    Rule,
    slots,
)

IF: Final = 0
"""A decision node begins; a condition and two trees follow."""
FEATURE: Final = 1
"""The feature `argument` of a condition; its constant follows."""
CONSTANT: Final = 2
"""The constant `constants[argument]`; it ends a condition."""
ACTION: Final = 3
"""A leaf that holds the action `argument`."""
CHOICE: Final = 4
"""One of the bodies of the rule `argument`."""
RANGE: Final = 5
"""One of the constants of the range `argument`; it ends a condition."""
END: Final = 6
"""The body is over."""

MAX_SYMBOLS: Final = 10_000
"""The longest body; rules that have no choice could otherwise double each other without end."""

_Symbol = tuple[int, int]


class Program(NamedTuple):
    """The arrays that the kernel reads: `S` symbols, `G` ranges.

    Attributes:
        symbol_kind: [S] int32, `IF` to `END`; the start's body comes first.
        symbol_argument: [S] int32, what the kind says.
        symbol_choices: [S] uint32, what a codon is divided by: the bodies of a rule, the constants of a range, or 1.
        symbol_first_body: [S] int32, for a `CHOICE` where the rule's bodies stand in `body_start`, else 0.
        body_start: int32, the first symbol of each body.
        range_low: [G] int64; constant i of a range is `(low + i * step) / scale`.
        range_step: [G] int64.
        range_scale: [G] float64.
        constants: float32, the constants that are no choice.
    """

    symbol_kind: NDArray[np.int32]
    symbol_argument: NDArray[np.int32]
    symbol_choices: NDArray[np.uint32]
    symbol_first_body: NDArray[np.int32]
    body_start: NDArray[np.int32]
    range_low: NDArray[np.int64]
    range_step: NDArray[np.int64]
    range_scale: NDArray[np.float64]
    constants: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class RuleTables:
    """A compiled grammar.

    Attributes:
        grammar: The grammar.
        program: What the kernel runs.
        rule_kinds: [R] what a rule derives. A rule comes after those that it has as whole productions and
            after those of a kind that its own kind is made of.
        rule_bodies: [R] for each rule the symbols that its bodies begin at.
        ranges: [G] the ranges.
        splits_at_start: Number of splits in the start's body.
        splits_per_choice: The largest number of splits in any other body: what one more codon may add.
    """

    grammar: Grammar
    program: Program
    rule_kinds: tuple[Kind, ...]
    rule_bodies: tuple[tuple[int, ...], ...]
    ranges: tuple[Constants, ...]
    splits_at_start: int
    splits_per_choice: int


def compile_rules(grammar: Grammar) -> RuleTables:
    """Compile a grammar to tables.

    Only where there is a choice a codon is read: a rule of one production and a range of one constant read none.

    Args:
        grammar: The grammar.

    Returns:
        The tables.

    Raises:
        GrammarError: A production has more than `MAX_SYMBOLS` parts without a choice.
    """
    writer = _Writer(grammar)
    start = writer.body(grammar.start, Nonterminal(grammar.start.name, place=grammar.start.place))
    rules = [grammar.rules[name] for name in writer.rule_numbers]
    bodies = [writer.body(rule, production) for rule in rules for production in rule.productions]
    program = _program([start, *bodies], rules, writer)
    begins = iter(program.body_start.tolist())
    return RuleTables(
        grammar=grammar,
        program=program,
        rule_kinds=tuple(grammar.kinds[rule.name] for rule in rules),
        rule_bodies=tuple(tuple(islice(begins, len(rule.productions))) for rule in rules),
        ranges=tuple(writer.ranges),
        splits_at_start=start.count((IF, 0)),
        splits_per_choice=max((body.count((IF, 0)) for body in bodies), default=0),
    )


def _program(bodies: list[list[_Symbol]], rules: list[Rule], writer: _Writer) -> Program:
    symbols = np.array([symbol for body in bodies for symbol in body], np.int32)
    ends = np.cumsum([len(body) for body in bodies], dtype=np.int32)
    choices = np.array([len(rule.productions) for rule in rules], np.uint32)
    first_body = (np.cumsum(choices) - choices).astype(np.int32)
    counts = np.array([values.count for values in writer.ranges], np.uint32)
    kind, argument = symbols[:, 0].copy(), symbols[:, 1].copy()
    # The kernel finds all that a symbol needs at the symbol itself: a look-up less on its longest path.
    symbol_choices, symbol_first_body = np.ones(len(kind), np.uint32), np.zeros(len(kind), np.int32)
    symbol_choices[kind == CHOICE] = choices[argument[kind == CHOICE]]
    symbol_choices[kind == RANGE] = counts[argument[kind == RANGE]]
    symbol_first_body[kind == CHOICE] = first_body[argument[kind == CHOICE]]
    return Program(
        symbol_kind=kind,
        symbol_argument=argument,
        symbol_choices=symbol_choices,
        symbol_first_body=symbol_first_body,
        # The start's body is no rule's; each of the others begins where the one before it ends.
        body_start=ends[:-1],
        range_low=np.array([values.low for values in writer.ranges], np.int64),
        range_step=np.array([values.step for values in writer.ranges], np.int64),
        range_scale=np.array([values.scale for values in writer.ranges], np.float64),
        constants=np.array([values.value(0) for values in writer.constants], np.float32),
    )


class _Writer:
    """Writes bodies and numbers the rules, ranges and constants they refer to."""

    def __init__(self, grammar: Grammar) -> None:
        self._grammar = grammar
        self.rule_numbers = self._number_rules()
        self.ranges: dict[Constants, int] = {}
        self.constants: dict[Constants, int] = {}

    def _number_rules(self) -> Mapping[str, int]:
        ranks = list(Kind)
        # Sorting by kind is stable: within a kind, whole productions stay before the rules that have them.
        ordered = sorted(self._grammar.kinds, key=lambda name: ranks.index(self._grammar.kinds[name]))
        choosing = [name for name in ordered if len(self._grammar.rules[name].productions) > 1]
        return {name: number for number, name in enumerate(choosing)}

    def body(self, rule: Rule, production: Production) -> list[_Symbol]:
        symbols: list[_Symbol] = []
        pending = [production]
        while pending:
            if len(symbols) > MAX_SYMBOLS:
                fail(
                    rule.place,
                    f"a production of <{rule.name}> has more than {MAX_SYMBOLS} parts without a choice",
                )
            term = pending.pop()
            if isinstance(term, Nonterminal) and term.name not in self.rule_numbers:
                pending.append(self._grammar.rules[term.name].productions[0])
            elif not isinstance(term, LessThan):
                symbols.append(self._symbol(term))
            pending.extend(part for part, _ in reversed(slots(term)))
        return [*symbols, (END, 0)]

    def _symbol(self, term: If | Action | Feature | Constants | Nonterminal) -> _Symbol:
        match term:
            case If():
                return IF, 0
            case Action():
                return ACTION, term.index
            case Feature():
                return FEATURE, term.index
            case Nonterminal():
                return CHOICE, self.rule_numbers[term.name]
            case Constants():
                if term.count > 1:
                    return RANGE, self.ranges.setdefault(term, len(self.ranges))
                return CONSTANT, self.constants.setdefault(term, len(self.constants))
