"""A plant: a user's own dynamics, written as a class in one small file, read and checked here.

`docs/your_own_plant.md` tells what such a class holds. Whatever is missing or wrong in it is told in one line.
"""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

from ge_torchrl.environments.plants.file import code_digest, found, numbers_of, run_file, source_digest
from ge_torchrl.environments.plants.values import (
    PlantActions,
    actions_of,
    features_of,
    is_number,
    start_of,
)
from ge_torchrl.errors import EnvironmentFaultError

Function = Callable[..., Any]

_REFERENCE = re.compile(r"(?P<file>.+\.py):(?P<name>\w*)")
_STEPPED, _INTEGRATED = ("step",), ("derivative", "dt", "reward")
_REQUIRED = ("features", "actions", "start", "max_episode_steps")
_OPTIONAL = ("observe", "integrator", "terminated", "solved_at", "symmetry")
_FUNCTIONS = ("step", "derivative", "reward", "terminated", "observe")
_INTEGRATORS = ("rk4", "euler")


@dataclass(frozen=True, eq=False)
class Plant:
    """What a user's class says.

    Attributes:
        dynamics: How it was named, `file.py:Class`.
        features: [D] names of the observation's entries.
        units: [D] their units.
        actions: What it can be given.
        start: [N] (low, high) of each entry of the state that an episode begins with.
        max_episode_steps: Limit of an episode.
        solved_at: Mean return from which the task counts as solved.
        symmetry: Its mirror, as `env.symmetry` has it.
        functions: Its functions by name, as Python has them.
        dt: Time between two states of a derivative [s]; 0 where there is a step.
        integrator: "rk4" or "euler".
        numbers: Those that stand in its file under a name of their own: `env.kwargs` changes them.
        source: Digest of its file, and of what that imports from other files of the user's.
        digest: Of everything that its compiled code depends on.
    """

    dynamics: str
    features: tuple[str, ...]
    units: tuple[str, ...]
    actions: PlantActions
    start: tuple[tuple[float, float], ...]
    max_episode_steps: int
    solved_at: float | None
    symmetry: Mapping[str, Any]
    functions: Mapping[str, Function] = field(repr=False)
    dt: float
    integrator: str
    numbers: Mapping[str, float]
    source: str
    digest: str


def names_plant(environment_id: str) -> bool:
    """Tell whether an id names a plant, as `file.py:Class`."""
    return _REFERENCE.fullmatch(environment_id) is not None


_plants: dict[tuple[str, bytes], Plant] = {}


def read_plant(dynamics: str, numbers: Mapping[str, Any] | None = None) -> Plant:
    """Return the plant that `file.py:Class` names; the file is found as modules are, in the current folder first.

    Args:
        dynamics: A file and a class in it.
        numbers: By name, what takes the place of numbers in the file.

    Raises:
        EnvironmentFaultError: There is no such file, class or number, or something in it is missing or wrong.
    """
    matched = _REFERENCE.fullmatch(dynamics)
    if matched is None:
        raise EnvironmentFaultError(
            f"env.dynamics must be a file and a class in it, as in env.dynamics=plant.py:Cart; got {dynamics!r}"
        )
    path = found(matched["file"], dynamics)
    try:
        source = path.read_bytes()
    except OSError as error:
        raise EnvironmentFaultError(
            f"env.dynamics={dynamics}: cannot read {path}: {error.strerror}"
        ) from error
    chosen = _checked_numbers(numbers, read_plant(dynamics)) if numbers else {}
    key = (f"{path.resolve()}:{matched['name']} {dynamics} {json.dumps(chosen, sort_keys=True)}", source)
    if key not in _plants:
        module = run_file(path, source, chosen, dynamics)
        _plants[key] = _plant_of(_class_of(module, matched["name"], dynamics), module, source, dynamics)
    return _plants[key]


def _checked_numbers(numbers: Mapping[str, Any], plant: Plant) -> dict[str, float]:
    """Return numbers of the kinds that the file has; refuse what it has not."""
    for name, value in numbers.items():
        if name not in plant.numbers:
            alike = [known for known in plant.numbers if known.lower() == name.lower()]
            meant = f"; env.kwargs.{alike[0]} is one" if alike else ""
            raise EnvironmentFaultError(
                f"env.kwargs of env.dynamics={plant.dynamics} change numbers that stand in its file, outside the class "
                f"and under a name of their own, which are {', '.join(plant.numbers) or 'none'}; got {name}{meant}"
            )
        if not is_number(value):
            raise EnvironmentFaultError(
                f"env.kwargs.{name} must be a number, as {name} = {plant.numbers[name]:g} is one in "
                f"{plant.dynamics}; got {value!r}"
            )
    # A whole number that is typed for 2.5 stays what 2.5 is: other code is compiled for integers.
    return {
        name: float(value) if isinstance(plant.numbers[name], float) else value
        for name, value in numbers.items()
    }


def _class_of(module: ModuleType, name: str, dynamics: str) -> type:
    found = getattr(module, name, None) if name else None
    if not isinstance(found, type):
        there = [
            key for key, value in vars(module).items() if isinstance(value, type) and hasattr(value, "start")
        ]
        got = "no such name" if found is None else f"{found!r}"
        raise EnvironmentFaultError(
            f"env.dynamics={dynamics} must name a class; got {got}; the file has {', '.join(there) or 'no plant'}"
        )
    return found


def _plant_of(described: type, module: ModuleType, source: bytes, dynamics: str) -> Plant:
    _check_attributes(described, dynamics)
    functions = {
        name: _function(described, name, dynamics) for name in _FUNCTIONS if hasattr(described, name)
    }
    start = start_of(described, dynamics)
    features, units = features_of(described, dynamics)
    if "observe" not in functions and len(features) != len(start):
        raise EnvironmentFaultError(
            f"{dynamics}.features must name the {len(start)} entries of the state that start has, since there is no "
            f"observe; got {len(features)}: {', '.join(features)}"
        )
    values: dict[str, Any] = {
        name: getattr(described, name, None) for name in ("dt", "max_episode_steps", "solved_at", "symmetry")
    }
    _check_numbers(values, dynamics, is_integrated="derivative" in functions)
    integrator = getattr(described, "integrator", "rk4")
    if integrator not in _INTEGRATORS:
        raise EnvironmentFaultError(f'{dynamics}.integrator must be "rk4" or "euler"; got {integrator!r}')
    return Plant(
        dynamics=dynamics,
        features=features,
        units=units,
        actions=actions_of(described, dynamics),
        start=start,
        max_episode_steps=values["max_episode_steps"],
        solved_at=None if values["solved_at"] is None else float(values["solved_at"]),
        symmetry=dict(values["symmetry"] or {}),
        functions=functions,
        dt=float(values["dt"] or 0.0),
        integrator=integrator,
        numbers=numbers_of(module, source),
        source=source_digest(module, source),
        digest=code_digest(described, module, source),
    )


def _check_attributes(described: type, dynamics: str) -> None:
    """Refuse a class with unknown attributes, or without those that are needed."""
    known = (*_REQUIRED, *_STEPPED, *_INTEGRATED, *_OPTIONAL)
    own = {name for base in described.__mro__[:-1] for name in vars(base) if not name.startswith("_")}
    for name in sorted(own - set(known)):
        meant = difflib.get_close_matches(name, known, n=1)
        expected = f"{meant[0]}" if meant else f"one of {', '.join(known)}"
        raise EnvironmentFaultError(
            f"{dynamics}.{name} is unknown; expected {expected}; what is yours alone goes outside the class, or gets a "
            "name that begins with _"
        )
    if ("step" in own) == ("derivative" in own):
        both = "both" if "step" in own else "neither"
        raise EnvironmentFaultError(
            f"{dynamics} must have a step, or else a derivative with dt and reward; got {both}"
        )
    needed = (*_REQUIRED, *(_STEPPED if "step" in own else _INTEGRATED))
    for name in needed:
        if name not in own:
            raise EnvironmentFaultError(f"{dynamics}.{name} is missing; expected {', '.join(needed)}")
    for name in ("dt", "integrator", "reward", "terminated"):
        if "step" in own and name in own:
            raise EnvironmentFaultError(
                f"{dynamics}.{name} goes with a derivative; expected a step alone, which gives back what follows"
            )


def _function(described: type, name: str, dynamics: str) -> Function:
    """Return a function as Python has it, whether or not it is decorated with `njit` or `staticmethod`."""
    found = getattr(described, name)
    plain = getattr(found, "py_func", found)
    if not hasattr(plain, "__code__"):
        raise EnvironmentFaultError(f"{dynamics}.{name} must be a function; got {found!r}")
    expected = 1 if name in ("observe", "terminated") else 2
    code = plain.__code__
    if code.co_argcount != expected or code.co_kwonlyargcount or code.co_flags & 0x0C:
        arguments = "(state)" if expected == 1 else "(state, action)"
        got = ", ".join(code.co_varnames[: code.co_argcount])
        raise EnvironmentFaultError(f"{dynamics}.{name} must take {arguments}; got ({got})")
    function: Function = plain
    return function


def _check_numbers(values: Mapping[str, Any], dynamics: str, *, is_integrated: bool) -> None:
    limit, solved_at, dt = (values[name] for name in ("max_episode_steps", "solved_at", "dt"))
    if type(limit) is not int or limit < 1:
        raise EnvironmentFaultError(f"{dynamics}.max_episode_steps must be a number of steps; got {limit!r}")
    if solved_at is not None and type(solved_at) not in (int, float):
        raise EnvironmentFaultError(f"{dynamics}.solved_at must be a number or None; got {solved_at!r}")
    if is_integrated and not (type(dt) in (int, float) and 0 < dt < float("inf")):
        raise EnvironmentFaultError(f"{dynamics}.dt must be a time above 0, in seconds; got {dt!r}")
    if not isinstance(values["symmetry"] or {}, Mapping):
        raise EnvironmentFaultError(
            f'{dynamics}.symmetry must be as in env.symmetry, such as {{"negate": ["x"]}}; got {values["symmetry"]!r}'
        )
