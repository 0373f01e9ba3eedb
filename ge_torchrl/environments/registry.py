"""Gymnasium's registry: how an id is known there, and what to type for one that it does not know as it is."""

from __future__ import annotations

import importlib
import re
import warnings
from importlib.metadata import entry_points

import gymnasium as gym
from gymnasium.envs.registration import find_highest_version, get_env_id, parse_env_id

from ge_torchrl.errors import EnvironmentFaultError

# Gymnasium says so each time that an environment is made, in each process; we say it once.
_TOLD_BY_GYMNASIUM = r".*The environment .* is out of date"


def registered_id(environment_id: str) -> str:
    """Return the id as Gymnasium's registry knows it: without `module:`, which is for `gym.make` alone."""
    return environment_id.rpartition(":")[2]


def find_registered(environment_id: str) -> None:
    """Let a package register its environments, and refuse an id without its version, or of one that is gone.

    `gym.make` would take the newest version with a warning: what belongs to the id would not be found then.

    Args:
        environment_id: What `gym.make` takes.

    Raises:
        EnvironmentFaultError: There is another version of it.
    """
    _register_plugin(environment_id)
    name = registered_id(environment_id)
    if name in gym.registry:
        _leave_it_to_us()
        return
    namespace, bare, version = parse_env_id(name)
    newest = find_highest_version(namespace, bare)
    if newest is None or (version is not None and version > newest):
        return
    told = "must name its version" if version is None else "is deprecated, and no longer there"
    there = environment_id.removesuffix(name) + get_env_id(namespace, bare, newest)
    raise EnvironmentFaultError(f"env.id={environment_id} {told}; type env.id={there}")


def newer_version(environment_id: str) -> str | None:
    """Return the id of the newest version of an environment that is registered; None where it is that.

    Args:
        environment_id: What `gym.make` took.
    """
    name = registered_id(environment_id)
    if name not in gym.registry:
        return None
    namespace, bare, version = parse_env_id(name)
    newest = find_highest_version(namespace, bare)
    if version is None or newest is None or newest <= version:
        return None
    return environment_id.removesuffix(name) + get_env_id(namespace, bare, newest)


def _leave_it_to_us() -> None:
    # A filter that is added again lets all warnings that were shown be shown again.
    quiet = ("ignore", re.compile(_TOLD_BY_GYMNASIUM, re.IGNORECASE), DeprecationWarning, None, 0)
    if quiet not in warnings.filters:
        warnings.filterwarnings("ignore", _TOLD_BY_GYMNASIUM, DeprecationWarning)


def _register_plugin(environment_id: str) -> None:
    """Let a package register its environments where it does so by an entry point, which Gymnasium 1 no longer calls."""
    module, name = environment_id.rpartition(":")[0], registered_id(environment_id)
    if not module or name in gym.registry:
        return
    importlib.import_module(module)
    if name not in gym.registry:
        package = module.partition(".")[0]
        for plugin in entry_points(group="gymnasium.envs"):
            if plugin.module.partition(".")[0] == package:
                plugin.load()()
