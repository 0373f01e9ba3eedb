"""Grammars of tests whose trees have weighted sums, or values at their leaves."""

from __future__ import annotations

from grammars_for_tests import ACTIONS, FEATURES, reachable_text
from hypothesis import HealthCheck, reject, settings
from hypothesis import strategies as st

from ge_torchrl.errors import GrammarError
from ge_torchrl.ge.grammar import Grammar, read_grammar

# Drawing a whole grammar takes long where a machine is busy, which says nothing of a test.
patient = settings(max_examples=30, suppress_health_check=[HealthCheck.too_slow])

FORCE = """
<dt>        ::= <leaf> | if <condition> then <dt> else <dt>
<condition> ::= lt(<linear>, [-1, 1] step 0.25) | lt(f0, [-2, 2] step 0.5)
<linear>    ::= <term> | <term> + <linear>
<term>      ::= [-2, 2] step 0.5 * f0 | [-4, 4] step 1 * f1
<leaf>      ::= act([-1, 1] step 0.25) | act([-1, 1] step 0.5 + <linear>)
"""

TWO = """
<dt>        ::= <leaf> | if lt(<linear>, 0) then <dt> else <dt>
<linear>    ::= <term> | <term> + <linear>
<term>      ::= [-2, 2] step 0.5 * f1 | [-4, 4] step 1 * f0
<leaf>      ::= act(<force>, <force>)
<force>     ::= [-1, 1] step 0.25 | [-1, 1] step 0.5 + <linear>
"""


def force_like() -> Grammar:
    """A grammar of oblique splits and linear leaves with one value."""
    return read_grammar(FORCE, FEATURES, ["force"], continuous=True)


def two_like() -> Grammar:
    """The same with two values; its text names feature 1 first."""
    return read_grammar(TWO, FEATURES, ["force", "brake"], continuous=True)


@st.composite
def grammars_with_terms(draw: st.DrawFn, n_values: int | None = None) -> Grammar:
    """Grammars of any form with sums, and with as many values at the leaves; 0 is actions."""
    entries = [f"e{number}" for number in range(draw(st.integers(0, 2)) if n_values is None else n_values)]
    text = reachable_text(_Writer(draw, entries).lines())
    try:
        return read_grammar(text, FEATURES, entries or ACTIONS, continuous=bool(entries))
    except GrammarError as error:
        # A sum can be another one whole, and that one the first: such rules are refused, as they should be.
        if "derives itself" not in str(error):
            raise
        reject()


class _Writer:
    """Draws rules of every kind: trees, conditions, features, constants, values and sums.

    First productions refer to later rules only, so every rule ends; whole productions too, so none is its own.
    """

    def __init__(self, draw, entries):
        self.draw = draw
        self.entries = entries
        self.counts = {kind: draw(st.integers(1, 3)) for kind in "tcfkvs"}

    def lines(self):
        lines = {}
        for kind, write in {
            "c": self.condition,
            "f": self.feature,
            "k": self.constant,
            "v": self.value,
        }.items():
            for number in range(self.counts[kind]):
                lines[f"{kind}{number}"] = [write(number + 1) for _ in range(self.draw(st.integers(1, 3)))]
        for kind, write in {"s": self.linear, "t": self.tree}.items():
            for number in range(self.counts[kind]):
                others = [write(number + 1, 0) for _ in range(self.draw(st.integers(0, 2)))]
                lines[f"{kind}{number}"] = [write(number + 1, number + 1), *others]
        return lines

    def one_of(self, choices):
        return self.draw(st.sampled_from(choices))

    def reference(self, kind, after):
        later = [f"<{kind}{number}>" for number in range(after, self.counts[kind])]
        return self.one_of(later) if later and self.draw(st.booleans()) else None

    def constant(self, after):
        literals = ["0", "-0.5", "1", "0.1", "[-1, 1] step 0.5", "[0.1, 0.9] step 0.2", "[0.5, 0.5] step 1"]
        return self.reference("k", after) or self.one_of(literals)

    def feature(self, after):
        return self.reference("f", after) or self.one_of(FEATURES)

    def part(self, inside):
        weighted = f"{self.constant(0)} * {self.feature(0)}"
        return self.one_of([self.feature(0), weighted, weighted, self.reference("s", inside) or weighted])

    def linear(self, after, inside):
        if found := self.reference("s", after):
            return found
        return " + ".join(self.part(inside) for _ in range(self.draw(st.integers(1, 3))))

    def condition(self, after):
        return self.reference("c", after) or f"lt({self.linear(0, 0)}, {self.constant(0)})"

    def value(self, after):
        forms = [self.constant(0), self.linear(0, 0), f"{self.constant(0)} + {self.linear(0, 0)}"]
        return self.reference("v", after) or self.one_of(forms)

    def tree(self, after, inside, depth=0):
        if found := self.reference("t", after):
            return found
        if depth == 2 or self.draw(st.booleans()):
            return (
                f"act({', '.join(self.value(0) for _ in self.entries)})"
                if self.entries
                else self.one_of(ACTIONS)
            )
        halves = [self.tree(inside, inside, depth + 1) for _ in range(2)]
        return f"if {self.condition(0)} then {halves[0]} else {halves[1]}"
