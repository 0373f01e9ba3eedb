"""What a value may be: one rule, one check, and one form of words for what is refused.

A rule states type and range. `checked` normalises what is only another spelling: an integral float becomes an int
(people type 1e6), an int a float where a float belongs, a list a tuple. Whatever else came is refused with a
`ConfigError` that names the key, what was expected, why, and what came.
"""

import difflib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any, Literal, NoReturn

from ge_torchrl.errors import ConfigError
from ge_torchrl.printing import shortened

MOST_EPISODES = 1_000_000
"""No call measures a tree on more: what it returned in each of them is held in memory."""
MOST = 10**15
"""No number of a setting is larger, unless its rule says so: it would fit neither into 64 bits nor into a float32."""
MOST_TREES = 1_000_000
"""No setting counts more trees: they are held in memory."""
MOST_SEED = 2**62
"""Episodes of higher seeds have none that follow: seeds are 64-bit integers."""
UNSET = "???"
"""The value of a key that somebody still has to fill in, as OmegaConf and YAML files write it."""

# Longer ones are told by their number of digits, which Python would not even write above some thousand.
_MOST_SHOWN = 10**30
# A value as a message shows it.
_LONGEST = 200

Kind = Literal["integer", "number", "flag", "text", "mapping"]


@dataclass(frozen=True)
class Rule:
    """Type and range of a value.

    Attributes:
        kind: What one value is.
        many: Whether a list of such values is meant.
        optional: Whether null is allowed too.
        at_least: The smallest number allowed.
        above: Numbers have to be larger than this.
        at_most: The largest number allowed.
        choices: The texts allowed; empty allows any that is not blank.
        distinct: Whether the texts of a list have to differ, and none may be blank.
        because: Why; empty where the range speaks for itself.
        text: What a text is, such as "a Gymnasium id such as CartPole-v1"; of keys with values an example.
        renamed: Former texts and what they are called now.
        lines: Whether a text may have several lines.
        largest: The largest number allowed where `at_most` is silent; it is told to whoever exceeds it.
    """

    kind: Kind
    many: bool = False
    optional: bool = False
    at_least: float = -math.inf
    above: float = -math.inf
    at_most: float = math.inf
    choices: tuple[str, ...] = ()
    distinct: bool = False
    because: str = ""
    text: str = "a text"
    renamed: tuple[tuple[str, str], ...] = ()
    lines: bool = False
    largest: int = MOST

    @property
    def expected(self) -> str:
        """What is allowed, in words that follow "must be"."""
        one = self._expected_list() if self.many else self._expected_one()
        return f"{one} or null" if self.optional else one

    def _expected_one(self) -> str:
        if self.kind == "flag":
            return "true or false"
        if self.kind == "mapping":
            return f"keys with values, such as {self.text}"
        if self.kind == "text":
            return f"one of {', '.join(self.choices)}" if self.choices else self.text
        if self.kind == "integer":
            return f"an integer{self._bounds()}"
        return f"{'a number' if self.at_most < math.inf else 'a finite number'}{self._bounds()}"

    def _expected_list(self) -> str:
        if self.kind == "text":
            return "a list of names that differ from each other" if self.distinct else "a list of texts"
        return ("a list of integers" if self.kind == "integer" else "a list of numbers") + self._bounds()

    def _bounds(self) -> str:
        if self.at_most < math.inf:
            return f" from {self.at_least:.15g} to {self.at_most:.15g}"
        if self.above > -math.inf:
            return f" above {self.above:g}"
        return f" of at least {self.at_least:g}" if self.at_least > -math.inf else ""

    def accepts(self, value: object) -> bool:
        """Tell whether one value, or one entry of a list, is allowed."""
        if self.kind == "flag":
            return isinstance(value, bool)
        if self.kind == "mapping":
            return isinstance(value, Mapping) and _is_plain(value)
        if self.kind == "text":
            return isinstance(value, str) and value != UNSET and self._accepts_text(value)
        if isinstance(value, bool) or not isinstance(value, Real) or self._is_beyond(value):
            return False
        number = float(value)
        if self.kind == "integer" and not (isinstance(value, Integral) or number.is_integer()):
            return False
        return number > self.above and self.at_least <= number <= self.at_most

    def _is_beyond(self, value: Any) -> bool:
        """Tell whether a number is larger than any that is of use, or is none."""
        return not -self.largest <= value <= self.largest

    def _accepts_text(self, value: str) -> bool:
        if not (self.lines or value.isprintable()):
            return False
        if self.choices:
            return value in self.choices
        return bool(value.strip()) or (self.many and not self.distinct)

    def normalised(self, value: Any) -> Any:
        """Return an allowed value in its one spelling."""
        if self.kind in ("flag", "text"):
            return value
        if self.kind == "mapping":
            return json.loads(json.dumps(dict(value)))
        return int(value) if self.kind == "integer" else float(value)


def _is_plain(value: Any) -> bool:
    """Tell whether a value is what JSON can say, with texts as keys."""
    if isinstance(value, Mapping):
        return all(isinstance(key, str) and _is_plain(inner) for key, inner in value.items())
    if isinstance(value, list | tuple):
        return all(map(_is_plain, value))
    if isinstance(value, float):
        return math.isfinite(value)
    return value is None or (isinstance(value, bool | int | str) and value != UNSET)


def _is_finite(value: Any) -> bool:
    """Tell whether all numbers within a value are finite."""
    if isinstance(value, Mapping | list | tuple):
        return all(map(_is_finite, value.values() if isinstance(value, Mapping) else value))
    return not isinstance(value, float) or math.isfinite(value)


def checked(key: str, value: object, rule: Rule) -> Any:
    """Return the value in its one spelling.

    Args:
        key: What the user calls it, such as `ge.population_size`.
        value: What came.
        rule: What is allowed.

    Raises:
        ConfigError: The rule does not allow the value.
    """
    if rule.optional and value is None:
        return None
    if not rule.many:
        if not rule.accepts(value):
            refuse(key, value, rule.expected, rule.because, _hint(value, rule))
        return rule.normalised(value)
    is_list = isinstance(value, Sequence) and not isinstance(value, str | bytes)
    entries: Iterable[object] = value if is_list else ()  # type: ignore[assignment]
    entries = tuple(entries)
    if (
        not is_list
        or not all(map(rule.accepts, entries))
        or (rule.distinct and len(set(entries)) < len(entries))
    ):
        refuse(key, value, rule.expected, rule.because)
    return tuple(map(rule.normalised, entries))


def _hint(value: object, rule: Rule) -> str:
    if math.isinf(rule.at_most) and isinstance(value, int | float) and math.inf > abs(value) > rule.largest:
        return f"it may be at most {rule.largest:.15g}"
    if isinstance(value, str) and not value.isprintable():
        return "a text is one line of printable characters"
    if rule.kind == "mapping" and not _is_finite(value):
        return "numbers must be finite"
    if not isinstance(value, str):
        return ""
    successor = dict(rule.renamed).get(value)
    return (
        f"{value} is now called {successor}" if successor else did_you_mean(value, rule.choices).lstrip("; ")
    )


def nearest(word: str, known: Iterable[str], n: int = 1, cutoff: float = 0.6) -> list[str]:
    """Return the names of a closed set that a mistyped one may stand for, the nearest first.

    Args:
        word: What was typed, in letters of any case.
        known: The names.
        n: So many at most.
        cutoff: How like they have to be, from 0 to 1.
    """
    plain = {name.lower(): name for name in known}
    return [plain[found] for found in difflib.get_close_matches(word.lower(), plain, n, cutoff)]


def did_you_mean(word: str, known: Iterable[str], cutoff: float = 0.6) -> str:
    """Return the end of a message that asks for the nearest name; empty where none is near. See `nearest`."""
    return "".join(f"; did you mean {found}?" for found in nearest(word, known, 1, cutoff))


def refuse(key: str, value: object, expected: str, because: str = "", hint: str = "") -> NoReturn:
    """Raise the error that says what a value should be and what it is.

    Args:
        key: What the user calls it.
        value: What came.
        expected: What is allowed, in words that follow "must be".
        because: Why.
        hint: What the user could do, such as "type ge.tournament_size=10".

    Raises:
        ConfigError: Always.
    """
    if isinstance(value, str) and value == UNSET:
        raise ConfigError(f"{key} has no value; expected {expected}; got nothing")
    reason = f", because {because}" if because else ""
    came = _as_typed(value)
    more = f"; {hint}" if hint else ""
    raise ConfigError(f"{key} must be {expected}{reason}; got {came}{more}")


def _as_typed(value: object) -> str:
    """Return a value as a user types it, not as Python shows it."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int) and abs(value) > _MOST_SHOWN:
        return f"an integer of {math.ceil(value.bit_length() * math.log10(2))} digits"
    try:
        return shortened(repr(list(value) if isinstance(value, tuple) else value), _LONGEST)
    except (ValueError, RecursionError):  # An integer of thousands of digits within, or too deep.
        return f"a {type(value).__name__}"
