"""What stands on the right side of a grammar's rule: a term for each way to write a tree or a part of one."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum
from typing import ClassVar

import numpy as np


class Kind(Enum):
    """What a term derives; its value names it in messages. A kind comes after those that it is made of."""

    CONSTANT = "a constant"
    FEATURE = "a feature"
    SUM = "a sum of features"
    VALUE = "a value"
    CONDITION = "a condition"
    TREE = "a tree"

    @property
    def expected(self) -> str:
        """What messages say where this kind, or one that serves as it, is expected."""
        return {Kind.SUM: "a feature or a sum of features", Kind.VALUE: "a constant or a sum"}.get(
            self, self.value
        )

    def serves_as(self, expected: Kind) -> bool:
        """Tell whether this kind may stand where another is expected: a feature is a sum, both are values."""
        return self is expected or expected in _SERVES.get(self, ())


_SERVES = {Kind.CONSTANT: (Kind.VALUE,), Kind.FEATURE: (Kind.SUM, Kind.VALUE), Kind.SUM: (Kind.VALUE,)}


def joined(first: Kind, second: Kind) -> Kind | None:
    """Return the kind of what is of either kind; None where there is none."""
    if first.serves_as(second):
        return second
    if second.serves_as(first):
        return first
    values = all(kind.serves_as(Kind.VALUE) for kind in (first, second))
    return Kind.VALUE if values else None


@dataclass(frozen=True)
class Place:
    """A position in a grammar's text, counted from 1."""

    line: int
    column: int

    def __str__(self) -> str:
        return f"line {self.line}, column {self.column}"


@dataclass(frozen=True)
class _Term:
    """A term and where it was written; two terms that differ only in their place are equal.

    Attributes:
        KIND: What it derives.
        PARTS: The fields that hold its parts, in the order of derivation, each with the kind that it has to be.
    """

    PARTS: ClassVar[tuple[tuple[str, Kind], ...]] = ()
    place: Place = field(compare=False, repr=False, kw_only=True)

    @property
    def slots(self) -> tuple[Slot, ...]:
        """The parts of the term in the order of derivation, each with the kind that it has to be."""
        parts: list[Slot] = []
        for name, kind in self.PARTS:
            part = getattr(self, name)
            parts += ((one, kind) for one in (part if isinstance(part, tuple) else (part,)))
        return tuple(parts)


@dataclass(frozen=True)
class Action(_Term):
    """A leaf that holds the action `index`."""

    KIND: ClassVar = Kind.TREE

    index: int


@dataclass(frozen=True)
class Feature(_Term):
    """The observed feature `index`."""

    KIND: ClassVar = Kind.FEATURE

    index: int


@dataclass(frozen=True)
class Constants(_Term):
    """The numbers `(low + i * step) / scale` for i = 0 to count - 1, as float32.

    Integers and one division make every value the float32 of the correctly rounded double: no error
    accumulates, and 0 is 0. A number in the text is the constants of count 1.

    Attributes:
        low: The first value times `scale`.
        step: The distance of neighbours times `scale`, positive.
        scale: A power of ten.
        count: How many values there are, at least 1.
    """

    KIND: ClassVar = Kind.CONSTANT

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
class Product(_Term):
    """A weighted feature: a sum of one term."""

    KIND: ClassVar = Kind.SUM
    PARTS: ClassVar = (("weight", Kind.CONSTANT), ("feature", Kind.FEATURE))

    weight: Production
    feature: Production


@dataclass(frozen=True)
class Sum(_Term):
    """Two or more sums, added in their order."""

    KIND: ClassVar = Kind.SUM
    PARTS: ClassVar = (("parts", Kind.SUM),)

    parts: tuple[Production, ...]


@dataclass(frozen=True)
class Shifted(_Term):
    """The value `constant + linear`."""

    KIND: ClassVar = Kind.VALUE
    PARTS: ClassVar = (("constant", Kind.CONSTANT), ("linear", Kind.SUM))

    constant: Production
    linear: Production


@dataclass(frozen=True)
class LessThan(_Term):
    """The condition `linear < constant`; a lone feature is a sum too."""

    KIND: ClassVar = Kind.CONDITION
    PARTS: ClassVar = (("linear", Kind.SUM), ("constant", Kind.CONSTANT))

    linear: Production
    constant: Production


@dataclass(frozen=True)
class Answer(_Term):
    """A leaf that holds a value for each entry of a Box action."""

    KIND: ClassVar = Kind.TREE
    PARTS: ClassVar = (("values", Kind.VALUE),)

    values: tuple[Production, ...]


@dataclass(frozen=True)
class If(_Term):
    """A decision node: `then` is the branch of TRUE, `otherwise` that of FALSE."""

    KIND: ClassVar = Kind.TREE
    PARTS: ClassVar = (("condition", Kind.CONDITION), ("then", Kind.TREE), ("otherwise", Kind.TREE))

    condition: Production
    then: Production
    otherwise: Production


Production = Action | Feature | Constants | Nonterminal | Product | Sum | Shifted | LessThan | Answer | If
Slot = tuple[Production, Kind]


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


def terms(production: Production) -> Iterator[Production]:
    """Yield a production and all terms inside it, in the order of derivation."""
    pending = [production]
    while pending:
        term = pending.pop()
        yield term
        pending.extend(part for part, _ in reversed(term.slots))
