"""Checks of a frozen record's fields: type and range, in one form of words.

Each function checks one field of `record` and normalises what is only another spelling: an integral float
becomes an int (people type 1e6), an int a float where a float belongs, a list of texts a tuple. Whatever else
came is refused with a `ConfigError` that names the full key, what was expected, why, and what came. A
record's `SECTION` begins its keys.
"""

import math
from collections.abc import Sequence
from numbers import Integral, Real
from typing import Any, ClassVar, NoReturn, Protocol

from ge_torchrl.errors import ConfigError

UNSET = "???"
"""The value of a key that somebody still has to fill in, as OmegaConf and YAML files write it."""


class Record(Protocol):
    """A frozen record whose fields have keys of the form `SECTION.field`."""

    SECTION: ClassVar[str]


def check_integer(record: Record, name: str, at_least: int, because: str, *, optional: bool = False) -> None:
    """Refuse anything but an integer of at least `at_least`, or None where it is optional."""
    value = getattr(record, name)
    if optional and value is None:
        return
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if isinstance(value, bool) or not isinstance(value, Integral) or value < at_least:
        refuse(record, name, f"an integer of at least {at_least}{_or_null(optional)}", because)
    _set(record, name, int(value))


def check_integers(record: Record, name: str, at_least: int, because: str) -> None:
    """Refuse anything but a list of integers of at least `at_least`."""
    value = getattr(record, name)
    is_list = isinstance(value, Sequence) and not isinstance(value, str)
    if not is_list or not all(_is_integer(number) and number >= at_least for number in value):
        refuse(record, name, f"a list of integers of at least {at_least}", because)
    _set(record, name, tuple(int(number) for number in value))


def check_number(
    record: Record,
    name: str,
    *,
    above: float = -math.inf,
    at_least: float = -math.inf,
    optional: bool = False,
) -> None:
    """Refuse anything but a finite number above `above` and of at least `at_least`, or None where optional."""
    value = getattr(record, name)
    if optional and value is None:
        return
    if not _is_number(value) or not math.isfinite(value) or value <= above or value < at_least:
        bounds = [f" above {above:g}"] * (above > -math.inf) + [f" of at least {at_least:g}"] * (
            at_least > -math.inf
        )
        refuse(record, name, f"a finite number{''.join(bounds)}{_or_null(optional)}")
    _set(record, name, float(value))


def check_probability(record: Record, name: str, because: str = "it is a probability") -> None:
    """Refuse anything but a number from 0 to 1."""
    value = getattr(record, name)
    if not _is_number(value) or not 0 <= value <= 1:
        refuse(record, name, "a number from 0 to 1", because)
    _set(record, name, float(value))


def check_flag(record: Record, name: str) -> None:
    """Refuse anything but True and False."""
    if not isinstance(getattr(record, name), bool):
        refuse(record, name, "true or false")


def check_text(record: Record, name: str, expected: str) -> None:
    """Refuse anything but a text that is not blank."""
    value = getattr(record, name)
    if not isinstance(value, str) or not value.strip() or value == UNSET:
        refuse(record, name, expected)


def check_choice(record: Record, name: str, choices: Sequence[str]) -> None:
    """Refuse anything but one of the choices."""
    if getattr(record, name) not in choices:
        refuse(record, name, f"one of {', '.join(choices)}" if len(choices) > 1 else choices[0])


def check_names(record: Record, name: str, *, distinct: bool) -> None:
    """Refuse anything but a sequence of texts, where `distinct` all different and none blank."""
    value = getattr(record, name)
    if isinstance(value, str) or not isinstance(value, Sequence):
        refuse(record, name, "a list of texts")
    if not all(isinstance(text, str) for text in value):
        refuse(record, name, "a list of texts")
    if distinct and (len(set(value)) < len(value) or not all(text.strip() for text in value)):
        refuse(record, name, "names that differ from each other", "a tree is read by them")
    _set(record, name, tuple(value))


def refuse(record: Record, name: str, expected: str, because: str = "") -> NoReturn:
    """Raise the error that says what the field should be and what it is."""
    value = getattr(record, name)
    key = f"{record.SECTION}.{name}" if record.SECTION else name
    if isinstance(value, str) and value == UNSET:
        raise ConfigError(f"{key} has no value; expected {expected}; got nothing")
    reason = f", because {because}" if because else ""
    came = "null" if value is None else repr(value)
    raise ConfigError(f"{key} must be {expected}{reason}; got {came}")


def _is_integer(value: Any) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool)


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _or_null(optional: bool) -> str:
    return " or null" if optional else ""


def _set(record: Record, name: str, value: Any) -> None:
    # Within __post_init__ a frozen record may still be completed; afterwards nobody writes to it.
    object.__setattr__(record, name, value)
