"""What a plant's class says in values: its features, its actions and where episodes start."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ge_torchrl.errors import EnvironmentFaultError


@dataclass(frozen=True)
class PlantActions:
    """What a plant can be given.

    Attributes:
        names: [A] of the actions, or of the entries of a continuous one.
        values: [A] the number that each action stands for; empty where an action is its own number, counted from 0.
        bounds: [A] (low, high) of each entry of a continuous action, of float32 precision; empty where actions are
            choices.
    """

    names: tuple[str, ...]
    values: tuple[float, ...] = ()
    bounds: tuple[tuple[float, float], ...] = ()


def features_of(described: Any, dynamics: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return names and units of what is observed.

    Raises:
        EnvironmentFaultError: They are neither names nor names with units.
    """
    given: Any = described.features
    if isinstance(given, Mapping):
        names, units = tuple(given), tuple(given.values())
    elif isinstance(given, Sequence) and not isinstance(given, str):
        names, units = tuple(given), ("",) * len(given)
    else:
        names, units = (), ()
    if not names or not all(isinstance(text, str) for text in (*names, *units)):
        raise EnvironmentFaultError(
            f'{dynamics}.features must be names with units, such as {{"x": "m"}}, or names alone; got {given!r}'
        )
    _check_distinct(names, dynamics, "features")
    return names, units


def actions_of(described: Any, dynamics: str) -> PlantActions:
    """Return what a plant can be given.

    Raises:
        EnvironmentFaultError: It is none of the three forms that there are.
    """
    given: Any = described.actions
    is_list = isinstance(given, Sequence) and not isinstance(given, str)
    names = tuple(given) if is_list or isinstance(given, Mapping) else ()
    if names and all(isinstance(name, str) and name for name in names):
        _check_distinct(names, dynamics, "actions")
        if is_list:
            return PlantActions(names)
        values = tuple(given.values())
        if all(map(is_number, values)):
            return PlantActions(names, values=tuple(map(float, values)))
        bounds = [_interval(value) for value in values]
        if all(bound is not None and bound[0] < bound[1] for bound in bounds):
            rounded = (
                (float(np.float32(bound[0])), float(np.float32(bound[1]))) for bound in bounds if bound
            )
            return PlantActions(names, bounds=tuple(rounded))
    raise EnvironmentFaultError(
        f'{dynamics}.actions must be names of choices, ("left", "right"), or with the number that each stands for, '
        f'{{"left": -10.0, "right": 10.0}}, or numbers within bounds, {{"force": (-10.0, 10.0)}}; got {given!r}'
    )


def start_of(described: Any, dynamics: str) -> tuple[tuple[float, float], ...]:
    """Return (low, high) of each entry of the first state.

    Raises:
        EnvironmentFaultError: They are no bounds.
    """
    given: Any = described.start
    entries = list(given) if isinstance(given, Sequence) and not isinstance(given, str) else []
    bounds = [(float(entry), float(entry)) if is_number(entry) else _interval(entry) for entry in entries]
    known = tuple(bound for bound in bounds if bound is not None and bound[0] <= bound[1])
    if not known or len(known) != len(bounds):
        raise EnvironmentFaultError(
            f"{dynamics}.start must hold for each entry of the state the bounds between which it is drawn, or a number "
            f"that it is, such as [(-0.05, 0.05), 0.0]; got {given!r}"
        )
    return known


def _check_distinct(names: Sequence[str], dynamics: str, what: str) -> None:
    if twice := [name for name in names if names.count(name) > 1]:
        raise EnvironmentFaultError(
            f"{dynamics}.{what} must differ, since a tree is read by them; got {twice[0]} twice"
        )


def is_number(value: object) -> bool:
    """Tell whether a value is a finite number, and not True or False."""
    return isinstance(value, int | float | np.number) and not isinstance(value, bool) and math.isfinite(value)


def _interval(value: object) -> tuple[float, float] | None:
    if isinstance(value, Sequence) and len(value) == 2 and all(map(is_number, value)):
        return float(value[0]), float(value[1])
    return None
