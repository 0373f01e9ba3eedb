"""A state of a search as plain values and back: what a file could hold, and what tells two states apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass

import numpy as np

from ge_torchrl.search.archive import Archive, Contender, Member
from ge_torchrl.search.climbing import Climber, Climbers
from ge_torchrl.search.population import Population
from ge_torchrl.search.state import Counts, SearchState
from ge_torchrl.trees.forest import Forest, ForestArrays
from ge_torchrl.trees.tree import DecisionTree

_RECORDS = {
    record.__name__: record
    for record in (
        Archive, Climber, Climbers, Contender, Counts, DecisionTree, Forest, ForestArrays, Member, Population,
        SearchState,
    )
}  # fmt: skip


def plain(value):
    """Return numbers, texts, bytes and tuples of them; what else there is, a generator say, is refused.

    What the clock says is left out.
    """
    match value:
        case None | bool() | int() | float() | str() | bytes():
            told = value
        case np.generic():
            told = value.item()
        case np.ndarray():
            told = "array", value.dtype.str, value.shape, value.tobytes()
        case frozenset():
            told = "frozenset", tuple(sorted(plain(part) for part in value))
        case Mapping():
            told = "dict", tuple(sorted((plain(key), plain(part)) for key, part in value.items()))
        case tuple(_fields=names):
            told = type(value).__name__, _parts(value, names)
        case tuple() | list():
            told = "tuple", tuple(plain(part) for part in value)
        case _ if is_dataclass(value):
            told = type(value).__name__, _parts(value, [entry.name for entry in fields(value) if entry.init])
        case _:
            raise TypeError(f"a state must consist of numbers, texts, bytes and arrays; got {value!r}")
    return told


def _parts(value, names):
    return tuple((name, plain(getattr(value, name))) for name in names if not name.endswith("seconds"))


def rebuilt(value):
    """Return what `plain` took apart, with arrays of its own."""
    if not isinstance(value, tuple):
        return value
    kind, *parts = value
    if kind == "array":
        dtype, shape, content = parts
        return np.frombuffer(bytearray(content), dtype).reshape(shape)
    (parts,) = parts
    if kind in _RECORDS:
        return _RECORDS[kind](**{name: rebuilt(part) for name, part in parts})
    if kind == "dict":
        return {key: rebuilt(part) for key, part in parts}
    return {"tuple": tuple, "frozenset": frozenset}[kind](rebuilt(part) for part in parts)


def told_apart(value):
    """Return a text that is equal for equal values, to the byte; NaN equals itself."""
    return repr(plain(value))
