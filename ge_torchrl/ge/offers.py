"""What a grammar offers at each place of a tree: which features, and which numbers go with them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from ge_torchrl.ge.productions import (
    Answer,
    Constants,
    Feature,
    Kind,
    LessThan,
    Nonterminal,
    Place,
    Product,
    Production,
    Rule,
    Shifted,
    Sum,
    terms,
)

_NOWHERE: Final = Place(0, 0)
ZERO: Final = Constants(0, 1, 1, 1, place=_NOWHERE)
"""What a sum without a constant adds."""
ONE: Final = Constants(1, 1, 1, 1, place=_NOWHERE)
"""The weight of a feature that has none."""


@dataclass(frozen=True)
class SumOffer:
    """The sums that a place may hold.

    Attributes:
        weights: The weights of each feature, the features in the order of the text.
        fewest: How many terms a sum has at least.
        most: And at most, infinity where rules repeat.
    """

    weights: Mapping[int, tuple[Constants, ...]]
    fewest: float
    most: float


@dataclass(frozen=True)
class SplitOffer:
    """A condition of the grammar: its sums and their thresholds."""

    linear: SumOffer
    thresholds: tuple[Constants, ...]


@dataclass(frozen=True)
class EntryOffer:
    """An entry of a leaf's values.

    Attributes:
        alone: The constants of an entry without a sum.
        added: The constants in front of a sum; zero where a sum stands alone.
        linear: The sums, none at all where `added` is empty.
    """

    alone: tuple[Constants, ...]
    added: tuple[Constants, ...]
    linear: SumOffer

    @property
    def may_vanish(self) -> bool:
        """Whether a sum may have weights of zero alone."""
        return any(found_in(offered, 0.0) for offered in self.linear.weights.values())


def found_in(offered: Sequence[Constants], number: float) -> list[tuple[Constants, int]]:
    """Return the constants that equal a number, each with its index."""
    indices = ((constants, constants.find(number)) for constants in offered)
    return [(constants, index) for constants, index in indices if index is not None]


def nearest_in(offered: Sequence[Constants], number: float) -> float:
    """Return the constant nearest to a number; of two equally near ones the lower."""
    nearest = (constants.value(constants.nearest(number)) for constants in offered)
    return min(nearest, key=lambda value: (abs(value - number), value))


class Offers:
    """Reads what checked rules offer.

    Args:
        rules: The rules.
        kinds: What each of them derives.
    """

    def __init__(self, rules: Mapping[str, Rule], kinds: Mapping[str, Kind]) -> None:
        self._rules = rules
        self._lengths = _lengths(rules, kinds)

    def splits(self) -> tuple[SplitOffer, ...]:
        """Return what each condition offers, in the order of the text."""
        return tuple(
            SplitOffer(self._sums([term.linear]), self._constants(term.constant))
            for term in self._all_terms()
            if isinstance(term, LessThan)
        )

    def leaves(self) -> tuple[tuple[EntryOffer, ...], ...]:
        """Return what each `act(...)` offers for its entries, in the order of the text."""
        return tuple(
            tuple(self._entry(value) for value in term.values)
            for term in self._all_terms()
            if isinstance(term, Answer)
        )

    def _all_terms(self) -> Iterator[Production]:
        for rule in self._rules.values():
            for production in rule.productions:
                yield from terms(production)

    def _entry(self, value: Production) -> EntryOffer:
        alone: list[Constants] = []
        added: list[Constants] = []
        sums: list[Production] = []
        for term in self._alternatives([value]):
            if isinstance(term, Constants):
                alone.append(term)
            elif isinstance(term, Shifted):
                added += self._constants(term.constant)
                sums.append(term.linear)
            else:
                added.append(ZERO)
                sums.append(term)
        return EntryOffer(_distinct(alone), _distinct(added), self._sums(sums))

    def _sums(self, sums: Sequence[Production]) -> SumOffer:
        weights: dict[int, tuple[Constants, ...]] = {}
        for term in self._alternatives(sums, into_sums=True):
            is_bare = isinstance(term, Feature)
            offered = (ONE,) if is_bare else self._constants(term.weight) if isinstance(term, Product) else ()
            features = [term] if not isinstance(term, Product) else self._alternatives([term.feature])
            for feature in features:
                if isinstance(feature, Feature):
                    known = weights.get(feature.index, ())
                    weights[feature.index] = _distinct([*known, *offered])
        lengths = [_length(term, self._lengths) for term in sums]
        return SumOffer(
            weights,
            min((fewest for fewest, _ in lengths), default=math.inf),
            max((most for _, most in lengths), default=0),
        )

    def _constants(self, production: Production) -> tuple[Constants, ...]:
        return _distinct(term for term in self._alternatives([production]) if isinstance(term, Constants))

    def _alternatives(
        self, productions: Sequence[Production], *, into_sums: bool = False
    ) -> Iterator[Production]:
        """Yield what productions may become, rules replaced by theirs; of a sum its parts where asked for."""
        seen: set[str] = set()
        pending = list(reversed(productions))
        while pending:
            term = pending.pop()
            if isinstance(term, Nonterminal):
                if term.name not in seen:
                    seen.add(term.name)
                    pending.extend(reversed(self._rules[term.name].productions))
            elif isinstance(term, Sum) and into_sums:
                pending.extend(reversed(term.parts))
            else:
                yield term


def _distinct(constants: Iterable[Constants]) -> tuple[Constants, ...]:
    return tuple(dict.fromkeys(constants))


_Lengths = dict[str, tuple[float, float]]


def _lengths(rules: Mapping[str, Rule], kinds: Mapping[str, Kind]) -> _Lengths:
    """Return the fewest and the most terms of the sums that each rule derives."""
    lengths: _Lengths = {
        name: (math.inf, 0) for name, kind in kinds.items() if kind in (Kind.FEATURE, Kind.SUM)
    }
    n_rules, rounds, grew = len(lengths), 0, True
    while grew:
        grew = False
        for name, before in lengths.items():
            parts = [_length(production, lengths) for production in rules[name].productions]
            after = min(fewest for fewest, _ in parts), max(most for _, most in parts)
            if after != before:
                # What still grows after as many rounds as there are rules grows without end.
                lengths[name] = (after[0], math.inf if rounds > n_rules else after[1])
                grew = True
        rounds += 1
    return lengths


def _length(production: Production, of_rule: _Lengths) -> tuple[float, float]:
    match production:
        case Nonterminal():
            return of_rule[production.name]
        case Sum():
            parts = [_length(part, of_rule) for part in production.parts]
            return sum(fewest for fewest, _ in parts), sum(most for _, most in parts)
        case _:
            return 1, 1
