"""A grammar as flat integer tables: the program that the mapping's kernel runs.

A production becomes a body, a sequence of symbols in the order of derivation. A symbol is a kind and an
argument; a `CHOICE` stands for a rule, whose bodies one codon chooses from, as a call stands for a routine.
Rules that take no codon are written out in place, so every `CHOICE` and every `RANGE` reads exactly one.

A condition of one feature is `FEATURE` and its constant. Grammars that have sums or values say more: in front of every
feature stands its weight, a constant or `ONE`, and in front of every sum in a leaf what is added to it, a constant and
`VALUE`, or `ZERO`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import islice
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.ge.grammar import Grammar
from ge_torchrl.ge.grammar_checks import fail, kind_of
from ge_torchrl.ge.productions import (
    Action,
    Answer,
    Constants,
    Feature,
    If,
    Kind,
    Nonterminal,
    Product,
    Production,
    Rule,
    Shifted,
    Sum,
    terms,
)

IF: Final = 0
"""A decision node begins; a condition and two trees follow."""
FEATURE: Final = 1
"""The feature `argument` of a condition or a sum."""
CONSTANT: Final = 2
"""The constant `constants[argument]`."""
ACTION: Final = 3
"""A leaf that holds the action `argument`."""
CHOICE: Final = 4
"""One of the bodies of the rule `argument`."""
RANGE: Final = 5
"""One of the constants of the range `argument`."""
END: Final = 6
"""The body is over."""
ONE: Final = 7
"""The weight of a feature that has none."""
ANSWER: Final = 8
"""A leaf that holds values begins."""
ZERO: Final = 9
"""What is added to a sum that has no constant."""
VALUE: Final = 10
"""The last constant is added to the entry's sum, or is its value."""
NEXT: Final = 11
"""An entry of a leaf's values is over."""

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


class Room(NamedTuple):
    """Numbers of splits and of terms."""

    splits: int
    terms: int


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
        has_terms: Whether trees may have weighted sums, or values at their leaves.
        at_start: What the start's body has of splits and terms.
        per_choice: The largest numbers of them in any other body: what one more codon may add.
        feature_rank: [D] int32, the place of each feature in the sums of leaves of several entries; they share terms,
            which therefore stand in one order: that in which the text names the features.
    """

    grammar: Grammar
    program: Program
    rule_kinds: tuple[Kind, ...]
    rule_bodies: tuple[tuple[int, ...], ...]
    ranges: tuple[Constants, ...]
    has_terms: bool
    at_start: Room
    per_choice: Room
    feature_rank: NDArray[np.int32]

    def largest_tree(self, n_readable: int) -> Room:
        """Return the splits and the terms that no tree of so many codons has more of."""
        return Room(
            *(start + n_readable * more for start, more in zip(self.at_start, self.per_choice, strict=True))
        )


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
        has_terms=writer.has_terms,
        at_start=_content(start),
        per_choice=Room(*map(max, zip(Room(0, 0), *map(_content, bodies), strict=True))),
        feature_rank=np.array(grammar.feature_rank, np.int32),
    )


def _content(body: list[_Symbol]) -> Room:
    kinds = [kind for kind, _ in body]
    return Room(kinds.count(IF), kinds.count(FEATURE))


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


@dataclass(frozen=True)
class _Part:
    """A term that is to be written, and the kind that its place has."""

    term: Production
    expected: Kind


class _Writer:
    """Writes bodies and numbers the rules, ranges and constants they refer to."""

    def __init__(self, grammar: Grammar) -> None:
        self._grammar = grammar
        self.rule_numbers = self._number_rules()
        self.ranges: dict[Constants, int] = {}
        self.constants: dict[Constants, int] = {}
        productions = (production for rule in grammar.rules.values() for production in rule.productions)
        self.has_terms = grammar.continuous or any(
            isinstance(term, Product | Sum) for production in productions for term in terms(production)
        )

    def _number_rules(self) -> Mapping[str, int]:
        ranks = list(Kind)
        # Sorting by kind is stable: within a kind, whole productions stay before the rules that have them.
        ordered = sorted(self._grammar.kinds, key=lambda name: ranks.index(self._grammar.kinds[name]))
        choosing = [name for name in ordered if len(self._grammar.rules[name].productions) > 1]
        return {name: number for number, name in enumerate(choosing)}

    def body(self, rule: Rule, production: Production) -> list[_Symbol]:
        symbols: list[_Symbol] = []
        pending: list[_Symbol | _Part] = [_Part(production, self._grammar.kinds[rule.name])]
        while pending:
            if len(symbols) > MAX_SYMBOLS:
                fail(
                    rule.place,
                    f"a production of <{rule.name}> has more than {MAX_SYMBOLS} parts without a choice",
                )
            part = pending.pop()
            if not isinstance(part, _Part):
                symbols.append(part)
            elif isinstance(part.term, Nonterminal) and part.term.name not in self.rule_numbers:
                only, *_ = self._grammar.rules[part.term.name].productions
                pending.append(_Part(only, part.expected))
            else:
                pending += reversed(self._written(part.term, part.expected))
        return [*symbols, (END, 0)]

    def _written(self, term: Production, expected: Kind) -> list[_Symbol | _Part]:
        """Return a term's symbols and parts, and the symbols that make it one of the expected kind."""
        kind = kind_of(term, self._grammar.kinds)
        before, after = list[_Symbol](), list[_Symbol]()
        if self.has_terms:
            before += [(ZERO, 0)] * (expected is Kind.VALUE and kind in (Kind.FEATURE, Kind.SUM))
            before += [(ONE, 0)] * (expected in (Kind.SUM, Kind.VALUE) and kind is Kind.FEATURE)
            after += [(VALUE, 0)] * (expected is Kind.VALUE and kind is Kind.CONSTANT)
        return [*before, *self._symbol(term), *self._parts(term), *after]

    def _parts(self, term: Production) -> list[_Symbol | _Part]:
        parts: list[_Symbol | _Part] = [(ANSWER, 0)] if isinstance(term, Answer) else []
        for part, expected in term.slots:
            parts.append(_Part(part, expected))
            if isinstance(term, Answer):
                parts.append((NEXT, 0))
            elif isinstance(term, Shifted) and part is term.constant:
                parts.append((VALUE, 0))
        return parts

    def _symbol(self, term: Production) -> list[_Symbol]:
        symbol: list[_Symbol] = []
        match term:
            case If():
                symbol = [(IF, 0)]
            case Action():
                symbol = [(ACTION, term.index)]
            case Feature():
                symbol = [(FEATURE, term.index)]
            case Nonterminal():
                symbol = [(CHOICE, self.rule_numbers[term.name])]
            case Constants() if term.count > 1:
                symbol = [(RANGE, self.ranges.setdefault(term, len(self.ranges)))]
            case Constants():
                symbol = [(CONSTANT, self.constants.setdefault(term, len(self.constants)))]
        return symbol
