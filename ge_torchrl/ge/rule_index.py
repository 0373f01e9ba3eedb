"""Which rules, and which of their bodies, are worth a try: a sum of a hundred features has a body for each of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from ge_torchrl.ge.productions import Kind
from ge_torchrl.ge.rule_tables import (
    ANSWER,
    CHOICE,
    CONSTANT,
    END,
    FEATURE,
    NEXT,
    ONE,
    RANGE,
    ZERO,
    RuleTables,
)
from ge_torchrl.ge.sentences import OUTSIDE

NUMBERS: Final = (RANGE, CONSTANT, ONE, ZERO)
"""The symbols that say a number."""

Symbols = Sequence[tuple[int, int]]
"""[S] kind and argument of every symbol."""


class Bodies(NamedTuple):
    """The bodies of a rule.

    Attributes:
        others: All that are no product of a number and a feature.
        products: The products, by their feature.
        zero: Of the products whose weight can be 0 one with the fewest codons, or none.
    """

    others: Sequence[int]
    products: Mapping[int, Sequence[int]]
    zero: Sequence[int]


def bodies_by_feature(
    symbols: Symbols, bodies: Iterable[int], can_be_zero: Callable[[int, int], bool]
) -> Bodies:
    """Sort the bodies of a rule by the feature that they derive at all.

    Args:
        symbols: Of the compiled grammar.
        bodies: The symbols that the rule's bodies begin at.
        can_be_zero: Tells of a symbol, by kind and argument, whether it says 0.
    """
    products: dict[int, list[int]] = {}
    others, zeros = list[int](), list[tuple[int, int]]()
    for body in bodies:
        number, *rest = _symbols_from(symbols, body)
        if number[0] not in NUMBERS or len(rest) != 1 or rest[0][0] != FEATURE:
            others.append(body)
            continue
        products.setdefault(rest[0][1], []).append(body)
        if can_be_zero(*number):
            zeros.append((int(number[0] == RANGE), body))
    return Bodies(others, products, [min(zeros)[1]] if zeros else [])


def rules_by_place(tables: RuleTables, symbols: Symbols, n_entries: int) -> dict[tuple[int, Kind], list[int]]:
    """Return the rules of each kind that derive parts of each entry of leaves' values, or of anything `OUTSIDE`.

    Args:
        tables: The compiled grammar.
        symbols: Its symbols.
        n_entries: How many values a leaf has.
    """
    chosen: dict[int, set[int]] = {}
    of_trees = (rule for rule, kind in enumerate(tables.rule_kinds) if kind is Kind.TREE)
    for body in (0, *(body for rule in of_trees for body in tables.rule_bodies[rule])):
        entry = OUTSIDE
        for kind, argument in _symbols_from(symbols, body):
            if kind == ANSWER:
                entry = 0
            elif kind == NEXT:
                entry = entry + 1 if entry + 1 < n_entries else OUTSIDE
            elif kind == CHOICE:
                chosen.setdefault(entry, set()).add(argument)
    places: dict[tuple[int, Kind], list[int]] = {}
    for entry, rules in chosen.items():
        for rule in sorted(_with_parts(tables, symbols, rules)):
            places.setdefault((entry, tables.rule_kinds[rule]), []).append(rule)
    return places


def _with_parts(tables: RuleTables, symbols: Symbols, rules: set[int]) -> set[int]:
    """Return rules and all that their bodies choose from."""
    found, pending = set(rules), list(rules)
    while pending:
        for body in tables.rule_bodies[pending.pop()]:
            parts = {argument for kind, argument in _symbols_from(symbols, body) if kind == CHOICE} - found
            found |= parts
            pending += parts
    return found


def _symbols_from(symbols: Symbols, body: int) -> Iterator[tuple[int, int]]:
    """Yield the symbols of a body, but its end."""
    while symbols[body][0] != END:
        yield symbols[body]
        body += 1
