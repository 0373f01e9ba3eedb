"""The reader of a grammar's text: its words, and one method for each form of the notation."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import NoReturn

from ge_torchrl.errors import GrammarError
from ge_torchrl.ge.codons import CODON_LIMIT
from ge_torchrl.ge.grammar_checks import fail
from ge_torchrl.ge.productions import (
    Action,
    Answer,
    Constants,
    Feature,
    If,
    LessThan,
    Nonterminal,
    Place,
    Product,
    Production,
    Rule,
    Sum,
)

_KEYWORDS = ("if", "then", "else", "lt", "step")
_WORD = r"[A-Za-z_][A-Za-z0-9_]*"
_TOKEN = re.compile(
    rf"""(?P<space>\s+|\#[^\n]*)
    |(?P<head><[A-Za-z0-9_-]+>\s*::=)
    |(?P<nonterminal><[A-Za-z0-9_-]+>)
    |(?P<number>[+-]?(?:[0-9]+(?:\.[0-9]+)?|\.[0-9]+))
    |(?P<word>{_WORD})
    |(?P<mark>[|(),\[\]+*])
    |(?P<unknown>.)""",
    re.VERBOSE | re.DOTALL,
)
_MAX_DIGITS, _MAX_NESTING, _MAX_RULES, _MAX_CHARACTERS = 15, 50, 1000, 4_000_000

_Words = Mapping[str, tuple[type[Feature | Action], int]]


def read_rules(
    text: str, features: Sequence[str], actions: Sequence[str], *, continuous: bool = False
) -> dict[str, Rule]:
    """Read the rules of a text, in its order; only the notation is checked, not what the rules amount to.

    Args:
        text: The rules.
        features: [D] names of the features.
        actions: [A] names of the actions.
        continuous: Whether they are the entries of a Box action. Then they are no words of the text.

    Returns:
        The rules by name.

    Raises:
        GrammarError: The text is not of the notation, or a name cannot be a word of it.
    """
    words = vocabulary(features, () if continuous else actions)
    if len(text) > _MAX_CHARACTERS:
        raise GrammarError(f"a grammar may have {_MAX_CHARACTERS} characters; this one has {len(text)}")
    return _Reader(text, words, tuple(actions) if continuous else ()).rules()


def vocabulary(features: Sequence[str], actions: Sequence[str]) -> _Words:
    """Return the words that names are in a text; refuse what cannot be one, or comes twice (`GrammarError`)."""
    words: dict[str, tuple[type[Feature | Action], int]] = {}
    for kind, names in ((Feature, features), (Action, actions)):
        for index, name in enumerate(names):
            if not re.fullmatch(_WORD, name) or name in _KEYWORDS:
                raise GrammarError(
                    "a name stands in the grammar's text, so it may hold only letters, digits and `_` "
                    f"and be none of {', '.join(_KEYWORDS)}; got {name!r}"
                )
            if name in words:
                raise GrammarError(
                    f"names of features and actions must differ from each other; {name!r} comes twice"
                )
            words[name] = (kind, index)
    return words


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    place: Place

    def __str__(self) -> str:
        return f"`{self.text}`" if self.text else "the end of the text"


def _tokens(text: str) -> list[_Token]:
    tokens, line, line_start = [], 1, 0
    for match in _TOKEN.finditer(text):
        place = Place(line, match.start() - line_start + 1)
        if match.lastgroup == "unknown":
            hint = "; a sum is joined by `+`, as in `x + -2 * y`" if match.group() == "-" else ""
            fail(place, f"unexpected character {match.group()!r}{hint}")
        if match.lastgroup != "space":
            tokens.append(_Token(str(match.lastgroup), match.group(), place))
        if ends := match.group().count("\n"):
            line += ends
            line_start = match.start() + match.group().rindex("\n") + 1
    return [*tokens, _Token("end", "", Place(line, len(text) - line_start + 1))]


class _Reader:
    """A recursive-descent reader: one method for each form of the notation."""

    def __init__(self, text: str, words: _Words, entries: tuple[str, ...]) -> None:
        self._tokens = _tokens(text)
        self._words = words
        self._entries = entries  # Of a Box action; none where actions are discrete.
        self._at = 0
        self._nesting = 0

    def rules(self) -> dict[str, Rule]:
        if self._next.kind == "end":
            fail(self._next.place, "expected a rule such as `<dt> ::= left`, but the text is empty")
        rules: dict[str, Rule] = {}
        while self._next.kind != "end":
            head = self._take("head", "a rule's beginning `<name> ::=`" if not rules else "`|` or a new rule")
            name = head.text[1 : head.text.index(">")]
            if name in rules:
                fail(
                    head.place, f"<{name}> has a rule already, at {rules[name].place}; join the two with `|`"
                )
            productions = [self._production()]
            while self._next.text == "|":
                self._take("mark")
                productions.append(self._production())
            rules[name] = Rule(name, tuple(productions), head.place)
            if len(rules) > _MAX_RULES:
                fail(head.place, f"a grammar may have {_MAX_RULES} rules; this one has more")
        return rules

    @property
    def _next(self) -> _Token:
        return self._tokens[self._at]

    def _take(self, kind: str, expected: str = "") -> _Token:
        token = self._next
        if token.kind != kind:
            fail(token.place, f"expected {expected}, found {token}")
        self._at += 1
        return token

    def _take_text(self, text: str) -> _Token:
        if self._next.text != text:
            fail(self._next.place, f"expected `{text}`, found {self._next}")
        return self._take(self._next.kind)

    def _production(self) -> Production:
        place = self._next.place
        parts = [self._product()]
        # `x +2 * y` and `x -2 * y` are sums too, whose signs belong to the numbers.
        while self._next.text == "+" or (self._next.kind == "number" and self._next.text[0] in "+-"):
            if self._next.text == "+":
                self._take("mark")
            parts.append(self._product())
        return parts[0] if len(parts) == 1 else Sum(tuple(parts), place=place)

    def _product(self) -> Production:
        place = self._next.place
        first = self._part()
        if self._next.text != "*":
            return first
        self._take("mark")
        return Product(first, self._part(), place=place)

    def _part(self) -> Production:
        token = self._next
        if token.kind == "nonterminal":
            self._take("nonterminal")
            return Nonterminal(token.text[1:-1], place=token.place)
        if token.kind == "number":
            return self._constants(token.place, [self._take("number")])
        if token.text == "[":
            return self._range()
        # Only with its bracket is `act` no name.
        if token.text in ("if", "lt") or (token.text == "act" and self._tokens[self._at + 1].text == "("):
            return self._nested()
        leaf = "`act`" if self._entries else "an action"
        word = self._take("word", f"{leaf}, a feature, a number, a range, `if`, `lt` or a nonterminal")
        return self._name(word)

    def _name(self, word: _Token) -> Production:
        if word.text not in self._words:
            self._refuse(word)
        term, index = self._words[word.text]
        return term(index, place=word.place)

    def _refuse(self, word: _Token) -> NoReturn:
        features, actions = (
            ", ".join(name for name, (of, _) in self._words.items() if of is kind)
            for kind in (Feature, Action)
        )
        if word.text in self._entries:
            fail(
                word.place,
                f"{word} is an entry of a Box action, whose leaves hold numbers: write `act(...)` with an "
                f"argument for each of {', '.join(self._entries)}",
            )
        known = f"the features are {features}"
        fail(
            word.place,
            f"unknown name {word}; {known}" + (f" and the actions are {actions}" if actions else ""),
        )

    def _nested(self) -> Production:
        keyword = self._take("word")
        self._nesting += 1
        if self._nesting > _MAX_NESTING:
            fail(keyword.place, f"terms nest deeper than {_MAX_NESTING} levels; give the inner ones a rule")
        forms: dict[str, Callable[[Place], Production]] = {
            "if": self._if,
            "lt": self._less_than,
            "act": self._answer,
        }
        term = forms[keyword.text](keyword.place)
        self._nesting -= 1
        return term

    def _answer(self, place: Place) -> Answer:
        if not self._entries:
            names = ", ".join(name for name, (of, _) in self._words.items() if of is Action)
            fail(
                place,
                "`act(...)` gives numbers, but the actions here are discrete: a leaf is the name of one of "
                f"them, {names}",
            )
        self._take_text("(")
        values = [self._production()]
        while self._next.text == ",":
            self._take("mark")
            values.append(self._production())
        self._take_text(")")
        if len(values) != len(self._entries):
            fail(
                place,
                f"`act` takes an argument for each entry of the action, {', '.join(self._entries)}, so "
                f"{len(self._entries)}; it has {len(values)}",
            )
        return Answer(tuple(values), place=place)

    def _if(self, place: Place) -> If:
        condition = self._production()
        self._take_text("then")
        then = self._production()
        self._take_text("else")
        return If(condition, then, self._production(), place=place)

    def _less_than(self, place: Place) -> LessThan:
        self._take_text("(")
        linear = self._production()
        self._take_text(",")
        constant = self._production()
        self._take_text(")")
        return LessThan(linear, constant, place=place)

    def _range(self) -> Constants:
        place = self._take_text("[").place
        numbers = [self._take("number", "a number, the lower end of the range")]
        self._take_text(",")
        numbers.append(self._take("number", "a number, the upper end of the range"))
        self._take_text("]")
        self._take_text("step")
        numbers.append(self._take("number", "a number, the step of the range"))
        return self._constants(place, numbers)

    def _constants(self, place: Place, numbers: Sequence[_Token]) -> Constants:
        """Return the constants of one number, or of a range's three: low, high and step."""
        decimals = 0
        for number in numbers:
            if sum(character.isdigit() for character in number.text) > _MAX_DIGITS:
                fail(
                    number.place,
                    f"a number may have {_MAX_DIGITS} digits, because more are not kept; got {number}",
                )
            decimals = max(decimals, len(number.text.partition(".")[2]))
        low, *rest = (int(Fraction(number.text) * 10**decimals) for number in numbers)
        if not rest:
            return Constants(low, 1, 10**decimals, 1, place=place)
        high, step = rest
        if step <= 0:
            fail(numbers[2].place, f"the step of a range must be positive, got {numbers[2]}")
        if high < low:
            fail(place, f"the range is empty: {numbers[0]} is greater than {numbers[1]}")
        count = (high - low) // step + 1
        if count > CODON_LIMIT or max(abs(low), abs(high)) >= 2**53:
            fail(
                place,
                f"the range is too fine: it may have {CODON_LIMIT} values, exact in a double; it has {count}",
            )
        return Constants(low, step, 10**decimals, count, place=place)
