"""What a grammar must fulfil beyond its syntax: a derivation is always a tree, and some derivation ends."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import replace
from graphlib import CycleError, TopologicalSorter
from typing import NoReturn

from ge_torchrl.errors import GrammarError
from ge_torchrl.ge.productions import (
    Answer,
    Constants,
    If,
    Kind,
    LessThan,
    Nonterminal,
    Place,
    Production,
    Rule,
    Shifted,
    Sum,
    joined,
    terms,
)


def check_rules(rules: Mapping[str, Rule]) -> dict[str, Kind]:
    """Check rules, of which the first is the start, and find out what each derives.

    Args:
        rules: The rules by name.

    Returns:
        The kind of every rule, ordered so that a rule stands after those it has as whole productions.

    Raises:
        GrammarError: A rule is undefined, derives itself and nothing else, mixes kinds, never ends or is
            never reached, or the start does not derive a tree.
    """
    _check_defined(rules)
    kinds = _kinds(rules)
    for rule in rules.values():
        for production in rule.productions:
            _check_slots(production, kinds)
    start = next(iter(rules.values()))
    if kinds[start.name] is not Kind.TREE:
        fail(
            start.place, f"the first rule must derive a tree, but <{start.name}> is {kinds[start.name].value}"
        )
    _check_productive(rules)
    _check_reachable(rules)
    return kinds


def fail(place: Place, message: str) -> NoReturn:
    """Raise a `GrammarError` for a place in the text."""
    raise GrammarError(f"{place}: {message}")


def told_apart(rules: Mapping[str, Rule]) -> dict[str, Rule]:
    """Return the rules with each sum whose first part is a constant as what it is: a value, not a sum of features."""
    constant = _found(
        rules, lambda rule, names: all(_is_constant(production, names) for production in rule.productions)
    )

    def replaced(term: Production) -> Production:
        match term:
            case Sum(parts=(first, *others)) if _is_constant(first, constant):
                linear = others[0] if len(others) == 1 else Sum(tuple(others), place=others[0].place)
                return Shifted(first, linear, place=term.place)
            case Answer():
                return replace(term, values=tuple(map(replaced, term.values)))
            case LessThan():
                return replace(term, linear=replaced(term.linear))
            case If():
                return replace(
                    term,
                    condition=replaced(term.condition),
                    then=replaced(term.then),
                    otherwise=replaced(term.otherwise),
                )
            case _:
                return term

    return {
        name: replace(rule, productions=tuple(map(replaced, rule.productions)))
        for name, rule in rules.items()
    }


def _found(rules: Mapping[str, Rule], belongs: Callable[[Rule, set[str]], bool]) -> set[str]:
    """Return the rules that belong to a set because of those that were found to belong before; the first need none."""
    names = set[str]()
    # A rule mostly stands above those that it refers to, so that nearly all belong in a first turn from below.
    asked = list(rules.items())[::-1]
    while True:
        left = []
        for name, rule in asked:
            if belongs(rule, names):
                names.add(name)
            else:
                left.append((name, rule))
        if len(left) == len(asked):
            return names
        asked = left


def _is_constant(production: Production, constant: Container[str]) -> bool:
    if isinstance(production, Nonterminal):
        return production.name in constant
    return isinstance(production, Constants)


def _check_defined(rules: Mapping[str, Rule]) -> None:
    for rule in rules.values():
        for name, place in _references(rule):
            if name not in rules:
                known = ", ".join(f"<{known}>" for known in rules)
                fail(place, f"<{name}> has no rule; the rules are {known}")


def _references(rule: Rule) -> list[tuple[str, Place]]:
    return [
        (term.name, term.place)
        for production in rule.productions
        for term in terms(production)
        if isinstance(term, Nonterminal)
    ]


def _kinds(rules: Mapping[str, Rule]) -> dict[str, Kind]:
    units = {
        name: [production.name for production in rule.productions if isinstance(production, Nonterminal)]
        for name, rule in rules.items()
    }
    try:
        order = list(TopologicalSorter(units).static_order())
    except CycleError as error:
        cycle = error.args[1][::-1]
        path = " -> ".join(f"<{name}>" for name in cycle)
        fail(rules[cycle[0]].place, f"<{cycle[0]}> derives itself without adding anything: {path}")
    kinds: dict[str, Kind] = {}
    for name in order:
        first, *others = rules[name].productions
        kinds[name] = kind_of(first, kinds)
        for production in others:
            kind = kind_of(production, kinds)
            if (both := joined(kinds[name], kind)) is None:
                fail(
                    production.place,
                    f"the productions of <{name}> must be of one kind; "
                    f"the first is {kinds[name].value}, this one is {kind.value}",
                )
            kinds[name] = both
    return kinds


def kind_of(production: Production, kinds: Mapping[str, Kind]) -> Kind:
    """Return what a production derives, from what the rules derive."""
    return kinds[production.name] if isinstance(production, Nonterminal) else production.KIND


def _check_slots(production: Production, kinds: Mapping[str, Kind]) -> None:
    for term in terms(production):
        for part, expected in term.slots:
            kind = kind_of(part, kinds)
            if not kind.serves_as(expected):
                fail(part.place, f"expected {expected.expected} here, but this is {kind.value}")


def _check_productive(rules: Mapping[str, Rule]) -> None:
    ending = _found(
        rules, lambda rule, names: any(_refers_only_to(names, production) for production in rule.productions)
    )
    for rule in rules.values():
        if rule.name not in ending:
            fail(rule.place, f"<{rule.name}> never ends: each of its productions leads back to itself")


def _refers_only_to(names: set[str], production: Production) -> bool:
    return all(term.name in names for term in terms(production) if isinstance(term, Nonterminal))


def _check_reachable(rules: Mapping[str, Rule]) -> None:
    start = next(iter(rules))
    reached, pending = {start}, [start]
    while pending:
        new = {name for name, _ in _references(rules[pending.pop()])} - reached
        reached |= new
        pending.extend(new)
    for rule in rules.values():
        if rule.name not in reached:
            fail(rule.place, f"<{rule.name}> is never used: no derivation from <{start}> reaches it")
