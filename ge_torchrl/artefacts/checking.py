"""Whether the values of a record are of their types and ranges, as their fields declare them."""

from __future__ import annotations

import math
import types
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NamedTuple, Union, get_args, get_origin, get_type_hints

from ge_torchrl.errors import ArtefactError
from ge_torchrl.printing import printable, shortened

# What is counted fits into 64 bits, and a time, a spread or a share is never below zero.
_MOST = 2**63 - 1
_NOT_NEGATIVE = ("_seconds", "_std", "_fraction", "_per_second", "complexity_M", "largest_parameter_move")


class _Form(NamedTuple):
    """What a value may be, in words and as a test."""

    expected: str
    accepts: Callable[[Any], bool]


def check_values(kind: type, values: dict[str, Any], source: str) -> None:
    """Refuse values that are not of the types and ranges of a record; texts are made printable in place.

    Args:
        kind: The record.
        values: Those of its fields that a file gives, an array as a tuple.
        source: The file's name in messages.

    Raises:
        ArtefactError: One is not.
    """
    for name, form in _forms(kind).items():
        if name not in values:
            continue
        if not form.accepts(values[name]):
            raise ArtefactError(f"{source}: {name} must be {form.expected}; got {_shown(values[name])}")
        if isinstance(values[name], str):
            values[name] = printable(values[name])
        elif isinstance(values[name], tuple):
            values[name] = tuple(map(printable, values[name]))


@cache
def _forms(kind: type) -> dict[str, _Form]:
    return {name: _form(name, annotation) for name, annotation in get_type_hints(kind).items()}


def _form(name: str, annotation: Any) -> _Form:
    if get_origin(annotation) in (types.UnionType, Union):
        (inner,) = (part for part in get_args(annotation) if part is not type(None))
        form = _form(name, inner)
        return _Form(f"{form.expected} or null", lambda value: value is None or form.accepts(value))
    if get_origin(annotation) is tuple:
        return _Form(
            "an array of texts", lambda value: isinstance(value, tuple) and all(map(_is_text, value))
        )
    if get_origin(annotation) is not None and issubclass(get_origin(annotation), Mapping):
        return _Form(
            "an object of counts",
            lambda value: isinstance(value, dict) and all(map(_is_count, value.values())),
        )
    if annotation is float:
        is_low = not name.endswith(_NOT_NEGATIVE)
        return _Form(
            "a finite number" if is_low else "a finite number of at least 0",
            lambda value: _is_number(value) and (is_low or value >= 0),
        )
    return {
        int: _Form("an integer of at least 0", _is_count),
        bool: _Form("true or false", lambda value: isinstance(value, bool)),
        str: _Form("a text", _is_text),
    }[annotation]


def _is_count(value: object) -> bool:
    return type(value) is int and 0 <= value <= _MOST


def _is_number(value: object) -> bool:
    if type(value) is int:
        return abs(value) <= _MOST
    return isinstance(value, float) and math.isfinite(value)


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _shown(value: object) -> str:
    """Return a value as a message shows it."""
    if isinstance(value, int) and abs(value) > _MOST:
        return "a larger integer"
    return shortened(repr(list(value) if isinstance(value, tuple) else value), 100)
