"""What a study found, as a file that `experiment=` chooses."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from ge_torchrl.artefacts.texts import told_of, write_text
from ge_torchrl.config.files import NO_ENVIRONMENT, default_choices
from ge_torchrl.tuning.space import Value, value_at
from ge_torchrl.tuning.task import Task
from ge_torchrl.version import __version__

_PROGRAM = "python -m ge_torchrl"
_LIMITS = ("ge.max_env_steps", "ge.max_seconds")


def name_of_study(words: Sequence[str], environment_id: str) -> str:
    """Return what a study is called by its environment: `mountaincar` for env=mountaincar.

    Args:
        words: What was typed of the run.
        environment_id: Its Gymnasium id, or dynamics.
    """
    chosen = [_parts(word)[1] for word in words if _parts(word)[0] in ("env", "experiment")]
    typed = next((choice for choice in reversed(chosen) if choice != NO_ENVIRONMENT), environment_id)
    return re.sub(r"\W+", "_", typed).strip("_").lower()


def preset_path(folder: Path, task: Task, name: str) -> Path:
    """Return where the preset of a study goes: beside its trials, or into the folder of choices that was typed."""
    return _choices_of(folder, task) / "experiment" / f"tuned_{name}.yaml"


def preset_command(folder: Path, task: Task, name: str) -> str:
    """Return the command that runs the preset."""
    return f"{_PROGRAM} --config-dir {shlex.quote(str(_choices_of(folder, task)))} experiment=tuned_{name}"


def comparing_commands(folder: Path, task: Task, name: str, seeds: str) -> tuple[str, str]:
    """Return the commands that run the preset, and the settings as they stand, on seeds that no trial has seen."""
    limits = {key: value_at(task.config.as_mapping(), key) for key in _LIMITS}
    given = [f"{key}={limit:.15g}" for key, limit in limits.items() if limit is not None]
    own = f" --config-dir {shlex.quote(task.config_dir)}" if task.config_dir else ""
    words = [word for word in task.words if _parts(word)[0] not in ("seed", *_LIMITS)]
    tuned = preset_command(folder, task, name).replace(_PROGRAM, f"{_PROGRAM} -m", 1)
    return f"{tuned} seed='{seeds}'", f"{_PROGRAM} -m{own} {shlex.join([*words, *given])} seed='{seeds}'"


def write_preset(path: Path, task: Task, values: Mapping[str, Value], told: Sequence[str]) -> None:
    """Write the preset.

    Args:
        path: Where.
        task: What was tuned.
        values: The settings that were found, by their keys.
        told: Lines that say where they come from.

    Raises:
        ArtefactError: The file cannot be written.
    """
    with told_of(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, preset_text(task, values, told))


def preset_text(task: Task, values: Mapping[str, Value], told: Sequence[str]) -> str:
    """Return the file: the choices and keys that were typed, the limit, and what was found; see `write_preset`."""
    mapping = task.config.as_mapping()
    chosen = dict(map(_parts, task.words))
    body: dict[str, Any]
    if "experiment" in chosen:
        # One experiment cannot build on any other, so all is written that it pins.
        body = {"defaults": [{"override /env": NO_ENVIRONMENT}], **mapping}
        del body["seed"], body["logger"], body["evaluation"]["steps_per_second"]
    else:
        body = {"defaults": [{f"override /{group}": choice} for group, choice in _choices(chosen)]}
        given = (key for key in _LIMITS if value_at(mapping, key) is not None)
        for key in (*given, *_typed(chosen)):
            _set(body, key, value_at(mapping, key))
    for key, value in values.items():
        _set(body, key, value)
    head = [f"# {line}" for line in (*told, f"Written by ge_torchrl {__version__}.")]
    return "\n".join(
        ["# @package _global_", *head, yaml.safe_dump(body, sort_keys=False, allow_unicode=True)]
    )


def _choices(chosen: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Yield the groups of files with what was chosen of them, the environment in any case."""
    groups = default_choices()
    yield "env", chosen.get("env", str(groups["env"]))
    yield from ((key, choice) for key, choice in chosen.items() if key in groups and key != "env")


def _typed(chosen: Mapping[str, str]) -> Iterator[str]:
    """Yield the keys that were typed, but for those that a run has for itself."""
    for key in chosen:
        if key not in (*default_choices(), "seed", "logger", *_LIMITS) and not key.startswith("hydra"):
            yield key


def _set(values: dict[str, Any], key: str, value: Any) -> None:
    *sections, name = key.split(".")
    for section in sections:
        values = values.setdefault(section, {})
    values[name] = value


def _choices_of(folder: Path, task: Task) -> Path:
    return folder if task.config_dir is None else Path(task.config_dir)


def _parts(word: str) -> tuple[str, str]:
    """Return key and value of an override, as they are typed."""
    key, _, value = word.partition("=")
    return key.lstrip("+~").strip(), value.strip().strip("'\"")
