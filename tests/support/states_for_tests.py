"""A state of a search as plain values and back: what a file could hold, and what tells two states apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass

import numpy as np

from ge_torchrl.search.archive import Archive, Contender, Member
from ge_torchrl.search.population import Population
from ge_torchrl.search.state import Counts, SearchState
from ge_torchrl.trees.forest import Forest, ForestArrays
from ge_torchrl.trees.tree import DecisionTree

_RECORDS = {
    record.__name__: record
    for record in (Archive, Contender, Counts, DecisionTree, Forest, ForestArrays, Member, Population, SearchState)
}  # fmt: skip


def plain(value):
    """Return numbers, texts, bytes and tuples of them; what else there is, a generator say, is refused.

    What the clock says is left out.
    """
    if value is None or isinstance(value, bool | int | float | str | bytes):
        return value
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, np.ndarray):
        return "array", value.dtype.str, value.shape, value.tobytes()
    if is_dataclass(value):
        return type(value).__name__, tuple(
            (entry.name, plain(getattr(value, entry.name)))
            for entry in fields(value)
            if entry.init and not entry.name.endswith("seconds")
        )
    if hasattr(value, "_asdict"):
        return type(value).__name__, tuple((name, plain(part)) for name, part in value._asdict().items())
    if isinstance(value, tuple | list):
        return "tuple", tuple(plain(part) for part in value)
    if isinstance(value, frozenset):
        return "frozenset", tuple(sorted(plain(part) for part in value))
    if isinstance(value, Mapping):
        return "dict", tuple(sorted((plain(key), plain(part)) for key, part in value.items()))
    raise TypeError(f"a state must consist of numbers, texts, bytes and arrays; got {value!r}")


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
