"""Which rules derive which parts of a tree, and with how few codons."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from ge_torchrl.ge.productions import Kind
from ge_torchrl.ge.rule_index import NUMBERS, bodies_by_feature, rules_by_place
from ge_torchrl.ge.rule_tables import CHOICE, CONSTANT, END, FEATURE, ONE, RANGE, VALUE, RuleTables
from ge_torchrl.ge.sentences import NUMBER, Sentence, said_by
from ge_torchrl.trees.tree import DecisionTree

Ends = Mapping[int, float]
"""Where a derivation may end, and the fewest codons that it takes."""
_NOWHERE: Ends = {}


class Derivations:
    """The derivations of a tree, found by dynamic programming from the end of its sentence to its beginning.

    A position is a word of the sentence, the next to be derived. Where leaves have several values, a derivation may
    have terms of weight zero that the tree does not have: with the weight of such a term it goes from position `p`
    to `~p`, and with any feature back.

    Args:
        target: The tree.
        tables: The compiled grammar.

    Attributes:
        sentence: What the grammar has to derive.
        symbols: [S] kind and argument of every symbol.
    """

    def __init__(self, target: DecisionTree, tables: RuleTables) -> None:
        program = tables.program
        kinds, arguments = program.symbol_kind.tolist(), program.symbol_argument.tolist()
        self.symbols: list[tuple[int, int]] = list(zip(kinds, arguments, strict=True))
        self.sentence: Sentence = said_by(target, tables)
        self._tables = tables
        self._n_entries = 0 if target.has_actions else target.value.shape[1]
        self._constants: list[float] = program.constants.tolist()
        self._any_feature = [math.inf] * len(tables.rule_bodies)
        self._found: dict[tuple[int, float], bool] = {}
        self._ends: list[dict[int, Ends]] = [{} for _ in tables.rule_bodies]
        self._bodies = [
            bodies_by_feature(self.symbols, bodies, self._can_be_zero) for bodies in tables.rule_bodies
        ]
        self._derive()

    def _derive(self) -> None:
        for rule, kind in enumerate(self._tables.rule_kinds):
            if kind is Kind.FEATURE:
                bodies = self._tables.rule_bodies[rule]
                self._any_feature[rule] = 1 + min(self.fewest_codons(body, ~0, {0: 0}) for body in bodies)
        rules = rules_by_place(self._tables, self.symbols, self._n_entries)
        for position in reversed(range(len(self.sentence.words))):
            for kind in self.sentence.kinds_at(position):
                # The tables' order of rules puts those that a rule has as whole productions before it. But a sum may
                # begin with any other.
                here = rules.get((self.sentence.entries[position], kind), ())
                changed = self._derive_at(position, here)
                while changed and kind is Kind.SUM:
                    changed = self._derive_at(position, here)

    def _derive_at(self, position: int, rules: Sequence[int]) -> bool:
        changed = False
        for rule in rules:
            ends: dict[int, float] = {}
            for body in self._bodies_at(rule, position):
                for end, codons in self._ends_of_body(body, position).items():
                    ends[end] = min(ends.get(end, math.inf), 1 + codons)
            changed |= ends != self._ends[rule].get(position, _NOWHERE)
            self._ends[rule][position] = ends
        return changed

    def _bodies_at(self, rule: int, position: int) -> Iterator[int]:
        """Return the bodies of a rule that may derive what begins at a position."""
        bodies, words = self._bodies[rule], self.sentence.words
        yield from bodies.others
        if bodies.products:
            kind, feature = words[position + 1] if position + 1 < len(words) else (END, 0)
            yield from bodies.products.get(feature, ()) if kind == FEATURE else ()
            yield from bodies.zero if self.sentence.may_add_zeros[position] else ()

    @property
    def fewest_codons_of_all(self) -> float:
        """The fewest codons that derive the tree; infinity where none do."""
        return self.fewest_codons(0, 0, {len(self.sentence.words) - 1: 0})

    def fewest_codons(self, at: int, position: int, after: Ends) -> float:
        """Return the fewest codons with which the body from symbol `at` on derives what begins at a position.

        Args:
            at: The body's first symbol.
            position: Where it begins.
            after: Where it may end, and the fewest codons for what comes then.

        Returns:
            The codons of both; infinity where it cannot.
        """
        ends = self._ends_of_body(at, position)
        return min((codons + after[end] for end, codons in ends.items() if end in after), default=math.inf)

    def _ends_of_body(self, at: int, position: int) -> Ends:
        reached: Ends = {position: 0}
        while self.symbols[at][0] != END and reached:
            reached = self._all_ends(at, reached)
            at += 1
        return reached

    def _all_ends(self, at: int, reached: Ends) -> Ends:
        if len(reached) == 1:
            ((position, before),) = reached.items()
            ends = self.ends(at, position)
            return {end: before + codons for end, codons in ends.items()} if before else ends
        together: dict[int, float] = {}
        for position, before in reached.items():
            for end, codons in self.ends(at, position).items():
                together[end] = min(together.get(end, math.inf), before + codons)
        return together

    def afters(self, at: int, position: int, after: Ends) -> list[Ends]:
        """Return for each symbol of a body where it may end, and the fewest codons for all that comes then.

        Args:
            at: The body's first symbol.
            position: Where it begins.
            after: Where it may end, and the fewest codons for what comes then.
        """
        reached: list[Ends] = [{position: 0}]
        while self.symbols[at][0] != END:
            reached.append(self._all_ends(at, reached[-1]))
            at += 1
        afters = [after]
        for place in reversed(range(1, len(reached) - 1)):
            at -= 1
            costs = {
                here: min(
                    (
                        codons + afters[-1][end]
                        for end, codons in self.ends(at, here).items()
                        if end in afters[-1]
                    ),
                    default=math.inf,
                )
                for here in reached[place]
            }
            afters.append({here: cost for here, cost in costs.items() if cost < math.inf})
        return afters[::-1]

    def ends(self, at: int, position: int) -> Ends:
        """Return where the symbol `at` may end that begins at a position, and with how few codons."""
        kind, argument = self.symbols[at]
        if position < 0:
            if kind == FEATURE:
                return {~position: 0}
            is_feature = kind == CHOICE and self._tables.rule_kinds[argument] is Kind.FEATURE
            return {~position: self._any_feature[argument]} if is_feature else _NOWHERE
        if kind == CHOICE:
            return self._ends[argument].get(position, _NOWHERE)
        if kind == VALUE:
            return {position: 0}
        if kind in NUMBERS:
            return self._ends_of_number(kind, argument, position)
        return {position + 1: 0} if self.sentence.words[position] == (kind, argument) else _NOWHERE

    def _ends_of_number(self, kind: int, argument: int, position: int) -> Ends:
        sentence, ends = self.sentence, dict[int, float]()
        is_number = sentence.words[position][0] == NUMBER
        if is_number and self._says(kind, argument, sentence.numbers[position]):
            ends[position + 1] = int(kind == RANGE)
        if sentence.may_add_zeros[position] and self._can_be_zero(kind, argument):
            ends[~position] = int(kind == RANGE)
        return ends

    def _can_be_zero(self, kind: int, argument: int) -> bool:
        return kind in (RANGE, CONSTANT) and self._says(kind, argument, 0.0)

    def _says(self, kind: int, argument: int, number: float) -> bool:
        if kind == RANGE:
            found = self._found.get((argument, number))
            if found is None:
                found = self._found[argument, number] = self._tables.ranges[argument].find(number) is not None
            return found
        return number == (self._constants[argument] if kind == CONSTANT else float(kind == ONE))

    def constants_at(self, constants: int, position: int, end: int, codon: int) -> list[int]:
        """Return which choice of a range gives the number at a position: the codon's own where it does.

        Args:
            constants: Number of the range.
            position: Where the number is.
            end: Where the range ends: a term of weight zero that the tree does not have is `~position`.
            codon: The codon that chooses.
        """
        values = self._tables.ranges[constants]
        number = 0.0 if end < 0 else self.sentence.numbers[position]
        if values.value(codon % values.count) == number:
            return [codon % values.count]
        index = values.find(number)
        return [] if index is None else [index]
