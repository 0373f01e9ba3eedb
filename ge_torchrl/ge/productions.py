"""What stands on the right side of a grammar's rule: a term for each way to write a tree or a part of one."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum

import numpy as np


class Kind(Enum):
    """What a term derives; its value names it in messages."""

    CONSTANT = "a constant"
    FEATURE = "a feature"
    CONDITION = "a condition"
    TREE = "a tree"


@dataclass(frozen=True)
class Place:
    """A position in a grammar's text, counted from 1."""

    line: int
    column: int

    def __str__(self) -> str:
        return f"line {self.line}, column {self.column}"


@dataclass(frozen=True)
class _Term:
    """Where a term was written; two terms that differ only in their place are equal."""

    place: Place = field(compare=False, repr=False, kw_only=True)


@dataclass(frozen=True)
class Action(_Term):
    """A leaf that holds the action `index`."""

    index: int


@dataclass(frozen=True)
class Feature(_Term):
    """The observed feature `index`."""

    index: int


@dataclass(frozen=True)
class Constants(_Term):
    """The thresholds `(low + i * step) / scale` for i = 0 to count - 1, as float32.

    Integers and one division make every value the float32 of the correctly rounded double: no error
    accumulates, and 0 is 0. A number in the text is the constants of count 1.

    Attributes:
        low: The first value times `scale`.
        step: The distance of neighbours times `scale`, positive.
        scale: A power of ten.
        count: How many values there are, at least 1.
    """

    low: int
    step: int
    scale: int
    count: int

    def value(self, index: int) -> float:
        """Return one of the constants, a float that float32 holds exactly."""
        return float(np.float32((self.low + index * self.step) / self.scale))

    def nearest(self, threshold: float) -> int:
        """Return the index of the constant nearest to a threshold; of two equally near ones the lower."""
        above = bisect_left(range(self.count), threshold, key=self.value)
        candidates = range(max(above - 1, 0), min(above + 1, self.count))
        return min(candidates, key=lambda index: abs(self.value(index) - threshold))

    def find(self, threshold: float) -> int | None:
        """Return the index of the constant that equals a threshold, None where there is none."""
        index = self.nearest(threshold)
        return index if self.value(index) == threshold else None


@dataclass(frozen=True)
class Nonterminal(_Term):
    """Whatever the rule `name` derives."""

    name: str


@dataclass(frozen=True)
class LessThan(_Term):
    """The condition `feature < constant`."""

    feature: Production
    constant: Production


@dataclass(frozen=True)
class If(_Term):
    """A decision node: `then` is the branch of TRUE, `otherwise` that of FALSE."""

    condition: Production
    then: Production
    otherwise: Production


Production = Action | Feature | Constants | Nonterminal | LessThan | If


@dataclass(frozen=True)
class Rule:
    """A nonterminal and the productions it chooses from.

    Attributes:
        name: Name of the nonterminal, without its angle brackets.
        productions: At least one.
        place: Where the rule begins.
    """

    name: str
    productions: tuple[Production, ...]
    place: Place = field(compare=False, repr=False)


def slots(term: Production) -> tuple[tuple[Production, Kind], ...]:
    """Return the parts of a term in the order of derivation, each with the kind that it has to be."""
    match term:
        case If():
            return (
                (term.condition, Kind.CONDITION),
                (term.then, Kind.TREE),
                (term.otherwise, Kind.TREE),
            )
        case LessThan():
            return (term.feature, Kind.FEATURE), (term.constant, Kind.CONSTANT)
        case _:
            return ()


def terms(production: Production) -> Iterator[Production]:
    """Yield a production and all terms inside it, in the order of derivation."""
    pending = [production]
    while pending:
        term = pending.pop()
        yield term
        pending.extend(part for part, _ in reversed(slots(term)))
