"""An environment's description on its way to a worker process, as Python's own processes send everything: pickled.

The bytes go from a process to those that it starts, and never come from a file.
"""

from __future__ import annotations

import importlib
import pickle
from typing import Any, cast

import gymnasium as gym

from ge_torchrl.environments.making import FAULTS
from ge_torchrl.environments.plants.plant import names_plant
from ge_torchrl.environments.registry import registered_id
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.errors import EnvironmentFaultError


def portable(spec: EnvironmentSpec) -> bytes:
    """Return what a new process needs to make the environment, itself registered by the calling program perhaps.

    Raises:
        EnvironmentFaultError: The environment cannot be sent to another process.
    """
    try:
        return pickle.dumps((spec, gym.registry.get(registered_id(spec.id))))
    except Exception as error:
        raise EnvironmentFaultError(
            f"env.id={spec.id} cannot be sent to worker processes ({' '.join(str(error).split())}); register it with "
            f'an entry point "module:Class", or set env.workers=1'
        ) from error


def unpack(sent: bytes) -> EnvironmentSpec:
    """Return the description that `portable` packed, and register the environment in this process.

    Raises:
        EnvironmentFaultError: This process cannot import what the environment is made of.
    """
    try:
        spec, registered = pickle.loads(sent)  # noqa: S301 (packed by the process that started this one)
        # Modules that register the environment themselves come first: Gymnasium warns of a second registration.
        for module in _modules_of(spec, registered):
            importlib.import_module(module)
    except FAULTS as error:
        raise EnvironmentFaultError(
            f"a worker process cannot import the environment ({error!r}); put it into a module, or set env.workers=1"
        ) from error
    if registered is not None:
        gym.registry.setdefault(registered.id, registered)
    return cast("EnvironmentSpec", spec)


def _modules_of(spec: EnvironmentSpec, registered: Any) -> list[str]:
    """Return the modules that the id and the entry point name in front of a colon, each once."""
    entry_point = getattr(registered, "entry_point", None)
    # A plant's file is no module; whoever makes the environment finds it.
    named = ["" if names_plant(spec.id) else spec.id, entry_point if isinstance(entry_point, str) else ""]
    return list(dict.fromkeys(module for text in named if (module := text.rpartition(":")[0])))
