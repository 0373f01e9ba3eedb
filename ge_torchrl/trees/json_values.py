"""Values of a JSON text, each taken as what it should be or refused with its key."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.reading import json_of

_INT32 = np.iinfo(np.int32)
# The least number that rounds to infinity: the decimal of the largest float32 may lie above that float32.
_OVERFLOW = 2.0**128 - 2.0**103


def parsed(text: str) -> dict[str, Any]:
    """Return the JSON object that a text holds."""
    try:
        content = json_of(text)
    except ValueError as error:
        raise InvalidTreeError(f"expected JSON, but {error}") from error
    if not isinstance(content, dict):
        raise InvalidTreeError(f"expected a JSON object, got {shown(content)}")
    return content


def keyed(
    value: object, expected: tuple[str, ...], key: str, optional: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Return an object that has the expected keys, perhaps the optional ones, and no other."""
    where = key or "the document"
    if not isinstance(value, dict):
        raise InvalidTreeError(f"{key}: expected an object, got {shown(value)}")
    if missing := [name for name in expected if name not in value]:
        raise InvalidTreeError(f"{inner(key, missing[0])}: expected in {where}, but it is missing")
    if unknown := [name for name in value if name not in (*expected, *optional)]:
        raise InvalidTreeError(
            f"{shown(unknown[0])}: not a key of {where}; its keys are {', '.join((*expected, *optional))}"
        )
    return value


def inner(key: str, name: str) -> str:
    """Return the key of an entry of the object at a key."""
    return f"{key}.{name}" if key else name


def mapping(value: object, key: str) -> Mapping[str, Any]:
    """Return any object."""
    if not isinstance(value, dict):
        raise InvalidTreeError(f"{key}: expected an object, got {shown(value)}")
    return value


def array(value: object, key: str) -> list[Any]:
    """Return an array of anything."""
    if not isinstance(value, list):
        raise InvalidTreeError(f"{key}: expected an array, got {shown(value)}")
    return value


def integer(value: object, key: str) -> int:
    """Return a 32-bit integer."""
    # JSON's true is an int to Python, so the type itself is asked for.
    if type(value) is not int or not _INT32.min <= value <= _INT32.max:
        raise InvalidTreeError(f"{key}: expected a 32-bit integer, got {shown(value)}")
    return value


def integers(value: object, key: str) -> list[int]:
    """Return an array of 32-bit integers."""
    return [integer(entry, f"{key}[{place}]") for place, entry in enumerate(array(value, key))]


def number(value: Any, key: str) -> float:
    """Return a number that is finite as a float32."""
    # NaN is not within the range either.
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not -_OVERFLOW < value < _OVERFLOW:
        raise InvalidTreeError(f"{key}: expected a finite float32 number, got {shown(value)}")
    return float(value)


def numbers(value: object, key: str) -> list[float]:
    """Return an array of numbers that are finite as float32."""
    return [number(entry, f"{key}[{place}]") for place, entry in enumerate(array(value, key))]


def string(value: object, key: str) -> str:
    """Return a string."""
    if not isinstance(value, str):
        raise InvalidTreeError(f"{key}: expected a string, got {shown(value)}")
    return value


def strings(value: object, key: str) -> tuple[str, ...]:
    """Return an array of strings."""
    return tuple(string(entry, f"{key}[{place}]") for place, entry in enumerate(array(value, key)))


def shown(value: object) -> str:
    """Return a value as a message shows it: short, and in one line."""
    return reprlib.repr(value)
