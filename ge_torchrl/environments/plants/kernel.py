"""A plant's kernel: the user's functions, compiled alone and over lanes.

The fused loops are those of every kernel; they call a plant by its address (`calling`), so only the plant itself is
compiled, once for each text of its file.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib.util
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
import numpy as np
from numba.core.errors import NumbaError, UnsupportedBytecodeError
from numpy.typing import NDArray

from ge_torchrl.compilation import cache_directory, compiled_in, entry_in
from ge_torchrl.environments.kernels.dynamics import Dynamics
from ge_torchrl.environments.kernels.lanes import Starts, uniform_states
from ge_torchrl.environments.plants.plant import Function, Plant, read_plant
from ge_torchrl.environments.plants.source import kernel_source, start_width
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.kernel_cache import reason_against, tell_not_kept

_Types = tuple[Any, ...]
# They carry no type information of their own.
types: Any = numba.types


@dataclass(frozen=True, eq=False)
class PlantKernel:
    """The compiled functions of a plant.

    Attributes:
        plant: What was compiled.
        step: State [N] and action to state [N], observation [D] of float32 precision, reward, whether it is terminated,
            and whether all of these are finite; tuples of floats.
        observation: State [N] to observation [D], likewise.
        dynamics: For the kernels; None where the plant is too large for their lanes.
    """

    plant: Plant
    step: Function
    observation: Function
    dynamics: Dynamics | None
    # What the address leads to lives as long as whoever has the address.
    _entry: object = field(repr=False)


_kernels: dict[Plant, PlantKernel] = {}


def plant_kernel(dynamics: str, numbers: Mapping[str, Any] | None = None) -> PlantKernel:
    """Return the compiled functions of a plant; its arguments are those of `read_plant`.

    Raises:
        EnvironmentFaultError: The plant is not there, or one of its functions is not what it has to be.
    """
    plant = read_plant(dynamics, numbers)
    if plant not in _kernels:
        _kernels[plant] = _compiled(plant)
    return _kernels[plant]


def first_states(plant: Plant, drawn: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return first states [..., N] of numbers in [0, 1) [..., N]."""
    low, high = np.array(plant.start).T
    states: NDArray[np.float64] = low + (high - low) * drawn
    return states


def _compiled(plant: Plant) -> PlantKernel:
    # Names of numba's files do not tell two plants of one file apart.
    folder = cache_directory() / f"plant-{plant.digest}"
    compile_here = compiled_in(folder)
    functions = {name: compile_here(function) for name, function in plant.functions.items()}
    _check_functions(plant, functions)
    bound: dict[str, Any] = {name.upper(): function for name, function in functions.items()}
    bound |= {"DT": plant.dt, "COMPILED": compile_here, "ENTERED": entry_in(folder)}
    made = _loaded(folder, plant, bound)
    entry: Any = getattr(made, "entry", None)
    return PlantKernel(
        plant=plant,
        step=made.step,
        observation=made.observation,
        dynamics=None if entry is None else Dynamics(entry.address, partial(_starts, plant, made.begin)),
        _entry=entry,
    )


def _starts(plant: Plant, begin: Function, seeds: NDArray[np.int64]) -> Starts:
    """[E, S] of a plant: every entry of the state uniform within its bounds."""
    low, high = np.array(plant.start).T
    states = uniform_states(low, high, seeds, len(plant.start))
    starts = np.zeros((len(states), start_width(plant)))
    begin(states, starts)
    return starts


def _written(folder: Path, name: str, text: str) -> Path:
    """Return the path of a module with this text."""
    path = folder / f"{name}.py"
    if not path.is_file() or path.read_bytes() != text.encode():
        # Another process may do the same: the file is there whole or not at all.
        temporary = folder / f".{name}.{os.getpid()}"
        temporary.write_bytes(text.encode())
        temporary.replace(path)
    return path


def _loaded(folder: Path, plant: Plant, bound: dict[str, Any]) -> ModuleType:
    """Return the module of a plant's kernel; it lies in a file, which is what numba caches by."""
    name, text = f"kernel_of_plant_{plant.digest}", kernel_source(plant)
    reason = reason_against(folder)
    if reason is None:
        try:
            path = _written(folder, name, text)
        except OSError as error:
            reason = error.strerror
    if reason is not None:
        tell_not_kept(folder, reason)
        elsewhere = tempfile.mkdtemp()
        atexit.register(shutil.rmtree, elsewhere, ignore_errors=True)
        path = _written(Path(elsewhere), name, text)
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ValueError(f"{path} is a Python file")
    module = importlib.util.module_from_spec(spec)
    vars(module).update(bound)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except OSError:
        raise
    except Exception as error:
        raise EnvironmentFaultError(f"{plant.dynamics} cannot be compiled: {_told(error)}") from error
    return module


def _check_functions(plant: Plant, functions: dict[str, Function]) -> None:
    """Compile each function by itself, and refuse what gives back something else than it has to."""
    n, n_features = len(plant.start), len(plant.features)
    state = types.UniTuple(types.float64, n)
    arguments: _Types = (state, _action_type(plant))
    by_entries = f"{_tuple_of(n)}, as start has entries"
    if "step" in functions:
        given = _result(plant, functions, "step", arguments)
        is_right = isinstance(given, types.BaseTuple) and len(given) == 3 and _are_numbers(given[0], n)
        if not (is_right and _is_number(given[1]) and _is_number(given[2])):
            _refuse(plant, "step", f"state, reward, terminated, where state is {by_entries}", given)
    else:
        given = _result(plant, functions, "derivative", arguments)
        if not _are_numbers(given, n):
            _refuse(plant, "derivative", by_entries, given)
    for name, its_arguments in (("reward", arguments), ("terminated", (state,))):
        if name in functions and not _is_number(given := _result(plant, functions, name, its_arguments)):
            _refuse(plant, name, "one number" if name == "reward" else "True or False", given)
    if "observe" in functions:
        given = _result(plant, functions, "observe", (state,))
        if not _are_numbers(given, n_features):
            _refuse(plant, "observe", f"{_tuple_of(n_features)}, as there are features", given)


def _result(plant: Plant, functions: dict[str, Function], name: str, arguments: _Types) -> Any:
    """Return the type that a function gives back."""
    function: Any = functions[name]
    try:
        function.compile(arguments)
    except OSError:
        # Of the cache.
        raise
    except Exception as error:  # Not all that numba raises is a NumbaError.
        raise EnvironmentFaultError(
            f"{plant.dynamics}.{name} must be code that numba compiles, for ({', '.join(map(_shown, arguments))}); "
            f"{_told(error)}"
        ) from error
    return function.overloads[arguments].signature.return_type


def _action_type(plant: Plant) -> Any:
    n_entries = len(plant.actions.bounds)
    if n_entries > 1:
        return types.UniTuple(types.float64, n_entries)
    return types.float64 if n_entries or plant.actions.values else types.int64


def _refuse(plant: Plant, name: str, expected: str, given: Any) -> None:
    raise EnvironmentFaultError(f"{plant.dynamics}.{name} must return {expected}; got {_shown(given)}")


def _tuple_of(n: int) -> str:
    return "a tuple of one number, (x,)" if n == 1 else f"a tuple of {n} numbers"


def _are_numbers(given: Any, n: int) -> bool:
    return isinstance(given, types.BaseTuple) and len(given) == n and all(_is_number(each) for each in given)


def _is_number(given: Any) -> bool:
    return isinstance(given, types.Number | types.Boolean)


def _shown(given: Any) -> str:
    if isinstance(given, types.BaseTuple):
        return f"({', '.join(_shown(each) for each in given)})"
    # Constants have types of their own, such as Literal[int](3).
    bare = re.sub(r"Literal\[(\w+)\]\(.*?\)", r"\1", str(given))
    return bare.replace("float64", "float").replace("int64", "int")


def _told(error: Exception) -> str:
    """Return the first thing that numba has to say, with the line of the user's file."""
    is_of_numba = isinstance(error, NumbaError | UnsupportedBytecodeError)
    text = str(error) if is_of_numba else f"{type(error).__name__}: {error}"
    text = re.sub(r"\x1b\[\d*m", "", text)
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    said = [line for line in lines if not line.startswith(("Failed in nopython mode", "File ", "During:"))]
    place = re.findall(r'File "[^"]*", line (\d+)|\.py \((\d+)\)', text)
    numbers = [first or second for first, second in place]
    first = said[:2] if said and said[0].endswith(":") else said[:1]
    what = " ".join(" ".join(first).split()).partition(" Raised from ")[0].rstrip(".")[:300]
    what = "imports go to the top of the file" if "IMPORT_NAME" in what else what or type(error).__name__
    with contextlib.suppress(IndexError):
        what += f" (line {numbers[-1]})"
    return what
