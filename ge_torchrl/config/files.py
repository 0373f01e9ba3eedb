"""The folder conf/: where it lies, what its groups offer, and what its files say."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ge_torchrl.checks import did_you_mean
from ge_torchrl.config.keys import check_choice
from ge_torchrl.errors import ArtefactError, ConfigError
from ge_torchrl.reading import MOST_SETTINGS_BYTES, YAMLLoader, name_of, read_text, yaml_of

_PACKAGE = Path(__file__).resolve().parents[1]
CONF = next(path for path in (_PACKAGE / "conf", _PACKAGE.parent / "conf") if path.is_dir())
"""A wheel carries the configuration within the package, a checkout beside it."""

NO_ENVIRONMENT = "default"
"""The choice of no particular environment."""

_THESIS = ("CartPole-v1", "Acrobot-v1", "MountainCar-v0")
_IS_ID = re.compile(r"-v\d+$")
# A file with this line says where its sections belong; any other is a section of its group.
_GLOBAL = re.compile(r"^# @package _global_\s*$", re.MULTILINE)


class _Loader(YAMLLoader):
    """Reads 1e-3 as the number that it is, as the command line does."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?\d+(?:\.\d*)?[eE][-+]?\d+$"), list("-+0123456789")
)


def choices(group: str) -> list[str]:
    """Return what a group of conf/ offers, `thesis/cartpole` for a file in a subfolder."""
    folder = CONF / group
    paths = (path for path in folder.rglob("*.yaml") if not path.name.startswith("_"))
    return sorted(path.relative_to(folder).with_suffix("").as_posix() for path in paths)


def default_choices() -> dict[str, str | None]:
    """Return the groups in the order in which their files are merged, with the choice that a run takes."""
    defaults = read_settings(CONF / "config.yaml", "")["defaults"]
    named = {
        group: choice for entry in defaults if isinstance(entry, dict) for group, choice in entry.items()
    }
    return {group: choice for group, choice in named.items() if "/" not in group}


def environment_ids() -> Iterator[tuple[str, str]]:
    """Yield each choice of an environment with its Gymnasium id."""
    for choice in choices("env"):
        if choice != NO_ENVIRONMENT:
            yield choice, str(read_choice("env", choice)["env"]["id"])


def choice_of(environment_id: str) -> str:
    """Return the choice of the environment whose file names this id; that of no particular one where none does."""
    return next((choice for choice, named in environment_ids() if named == environment_id), NO_ENVIRONMENT)


def read_choice(group: str, choice: str) -> dict[str, Any]:
    """Return what a file of conf/ says, its sections by name."""
    return read_settings(CONF / group / f"{choice}.yaml", group)


def read_settings(path: Path, group: str) -> dict[str, Any]:
    """Return what a YAML file says, its sections by name.

    Args:
        path: The file.
        group: The section that it is, unless its first line says that it holds sections.

    Raises:
        ConfigError: It cannot be read, or does not hold keys with values.
    """
    try:
        text = read_text(path, MOST_SETTINGS_BYTES)
        values = yaml_of(text, _Loader) or {}
    except (ArtefactError, ValueError) as error:
        raise ConfigError(f"{name_of(path)} must be a file of settings in YAML; {error}") from error
    if not isinstance(values, Mapping):
        raise ConfigError(f"{path} must hold keys with values; got {type(values).__name__}")
    named = {str(key): value for key, value in values.items()}
    return named if not group or _GLOBAL.search(text) else {group: named}


def check_sections(env: object) -> None:
    """Refuse a section `env` that holds sections, because its file does not say so in its first line.

    Raises:
        ConfigError: It does.
    """
    if isinstance(env, Mapping) and {"env", "grammar"} & set(env):
        raise ConfigError(
            "a file of env with the sections env and grammar must begin with # @package _global_; got none"
        )


def of_the_thesis(environment_id: str, values: Sequence[Any]) -> Any:
    """Return the value of one of the thesis' three environments; any other environment takes that of CartPole-v1.

    Args:
        environment_id: Gymnasium id.
        values: [3] of CartPole-v1, Acrobot-v1 and MountainCar-v0.
    """
    return values[_THESIS.index(environment_id) if environment_id in _THESIS else 0]


def unknown_choice(group: str, choice: str, offered: Iterable[str] = ()) -> ConfigError:
    """Return the error for a choice that a group does not offer.

    Args:
        group: The group of files, such as `env`.
        choice: What was asked for.
        offered: What is offered beside conf/.

    Raises:
        ConfigError: The choice is one of an earlier version, and now goes by another name.
    """
    check_choice(group, choice)
    others = (option for option in offered if not option.startswith("_"))
    known = sorted({*choices(group), *others})
    return ConfigError(
        f"{group}={choice} is unknown; expected one of {', '.join(known)}; got {choice}{_meant(group, choice, known)}"
    )


def _meant(group: str, choice: str, known: Sequence[str]) -> str:
    """Return the end of a message that asks for the choice that may be meant."""
    if group == "env" and _IS_ID.search(choice):
        return f"; an id is typed env.id={choice}"
    ends = [name for name in known if name.rpartition("/")[2] == choice]
    return f"; did you mean {ends[0]}?" if ends else did_you_mean(choice, known)
