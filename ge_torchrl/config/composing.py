"""A configuration composed of the files of conf/ and of values: what Hydra does for the command line, for the library.

Files are merged in the order of `conf/config.yaml`: what an environment brings along, then the other groups, then what
an experiment pins. Values by their keys come last.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from ge_torchrl.config.files import (
    check_sections,
    choice_of,
    choices,
    default_choices,
    of_the_thesis,
    read_choice,
    read_settings,
    unknown_choice,
)
from ge_torchrl.config.record import Config, check_key, template
from ge_torchrl.errors import ConfigError

_OVERRIDE = "override /"
# ${thesis:40, 15, 0} in a file: see of_the_thesis.
_OF_THE_THESIS = re.compile(r"\$\{thesis:(.*)\}")


def compose(environment: str | None, chosen: Mapping[str, str | None], settings: Mapping[str, Any]) -> Config:
    """Return the configuration of a run.

    Args:
        environment: A Gymnasium id, a choice of conf/env, a file as `init` writes, or dynamics such as
            `plant.py:Cart`; None for that of the experiment, or the default.
        chosen: Choices of the other groups by their names; None where the default stays.
        settings: Values by their keys, such as `ge.generations`.

    Raises:
        ConfigError: A choice, a key or a value is unknown or not allowed, or an experiment is of another environment.
    """
    typed = {group: choice for group, choice in chosen.items() if choice is not None}
    for group, choice in typed.items():
        _check_choice(group, choice)
    if not isinstance(settings, Mapping):
        raise ConfigError(
            f"settings must be keys with values, such as {{'ge.generations': 50}}; got {settings!r}"
        )
    if environment is None and "experiment" not in typed:
        # What is named by its key brings its file along too.
        environment = settings.get("env.id") or settings.get("env.dynamics")
    values = _composed(environment, typed, settings)
    if "experiment" in typed and (environment is not None or "env.id" in settings):
        others = {key: value for key, value in settings.items() if key != "env.id"}
        fixed = _composed(None, typed, others)["env"]["id"]
        without = {group: choice for group, choice in typed.items() if group != "experiment"}
        asked = _composed(environment, without, settings)["env"]["id"]
        if fixed != asked:
            raise ConfigError(
                f"experiment={typed['experiment']} fixes the environment, {fixed}, so expected no other one; "
                f"got {asked}"
            )
        values = _composed(None, typed, others)
    return Config.from_mapping(values)


def _composed(
    environment: str | None, typed: Mapping[str, str], settings: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the values of a run, before they are checked."""
    experiment = typed.get("experiment")
    taken = {**default_choices(), **(_pinned(experiment) if experiment else {}), **typed}
    own, first = (None, {}) if environment is None else _environment(environment)
    values = template()
    for group, choice in taken.items():
        if group == "env" and own is not None:
            _merge(values, own)
        elif group == "experiment" and choice is not None:
            for layer in _layers(choice):
                _merge(values, layer)
        elif choice is not None:
            _merge(values, read_choice(group, choice))
    for key, value in {**first, **settings}.items():
        _set(values, key, value)
    resolved: dict[str, Any] = _resolved(values, values["env"]["id"])
    return resolved


def _environment(environment: object) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what an environment brings along, and the values that name it besides."""
    if not isinstance(environment, str) or not environment.strip():
        raise ConfigError(
            "the environment must be the id of one that is registered, such as CartPole-v1; "
            f"got {environment!r}; one of your own is registered by gymnasium.register"
        )
    if environment.endswith((".yaml", ".yml")):
        layer = read_settings(Path(environment), "env")
        check_sections(layer.get("env"))
        return layer, {}
    if environment in choices("env"):
        return read_choice("env", environment), {}
    if ".py:" in environment:
        return {}, {"env.dynamics": environment}
    return read_choice("env", choice_of(environment)), {"env.id": environment}


def _check_choice(group: str, choice: object) -> None:
    if isinstance(choice, str) and choice in choices(group):
        return
    raise unknown_choice(group, str(choice))


def _layers(experiment: str) -> Iterator[dict[str, Any]]:
    """Yield what an experiment says, after what it builds on."""
    values = read_choice("experiment", experiment)
    for entry in values.pop("defaults", ()):
        if isinstance(entry, str):
            yield from _layers(entry)
    yield values


def _pinned(experiment: str) -> dict[str, str | None]:
    """Return the choices of groups that an experiment makes."""
    pinned: dict[str, str | None] = {}
    for entry in read_choice("experiment", experiment).get("defaults", ()):
        if isinstance(entry, str):
            pinned |= _pinned(entry)
        else:
            pinned |= {group.removeprefix(_OVERRIDE): choice for group, choice in entry.items()}
    return pinned


def _merge(values: dict[str, Any], layer: Mapping[str, Any]) -> None:
    """Put a layer over values; keys with values are merged, anything else takes the place of what was there."""
    for key, value in layer.items():
        values[key] = _merged(values.get(key), value)


def _merged(before: object, value: object) -> object:
    if not isinstance(value, Mapping):
        return value
    merged = dict(before) if isinstance(before, Mapping) else {}
    _merge(merged, value)
    return merged


def _set(values: dict[str, Any], key: object, value: object) -> None:
    if not isinstance(key, str):
        raise ConfigError(f"the keys of settings must be texts such as ge.generations; got {key!r}")
    check_key(key)
    if key == "env.symmetry" and value == {}:
        value = None  # A mirror without keys is none; merged, no keys would change nothing.
    *sections, name = key.split(".")
    node = values
    for section in sections:
        if not isinstance(node.get(section), dict):
            node[section] = {}
        node = node[section]
    node[name] = _merged(node.get(name), value)


def _resolved(value: Any, environment_id: str) -> Any:
    """Return values with those of the thesis' three environments looked up."""
    if isinstance(value, Mapping):
        return {key: _resolved(inner, environment_id) for key, inner in value.items()}
    if isinstance(value, str) and (found := _OF_THE_THESIS.fullmatch(value)):
        return of_the_thesis(environment_id, yaml.safe_load(f"[{found[1]}]"))
    return value
