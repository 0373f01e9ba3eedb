"""What a command line chooses of conf/, and what another folder may add."""

import re
import sys
from collections.abc import Collection, Sequence
from pathlib import Path

from ge_torchrl.config import Config
from ge_torchrl.config.files import (
    CONF,
    NO_ENVIRONMENT,
    check_sections,
    choice_of,
    read_settings,
)
from ge_torchrl.errors import ConfigError
from ge_torchrl.reading import is_there

# From which Hydra takes a --config-path.
_PACKAGE = Path(__file__).resolve().parents[1]
_NO_MIRROR = "env.symmetry=null"
_EMPTY_MIRROR = re.compile(r"\+{0,2}env\.symmetry=\s*\{\s*\}\s*")


def folder_from(config_path: str | None) -> Path:
    """Return the folder that --config-path names, as Hydra finds it: from the package's; conf/ where none is named."""
    return _PACKAGE / (config_path or CONF)


def check_file(folder: Path, config_name: str) -> None:
    """Refuse a file that a configuration begins with if no reader should be given it: a pipe, gigabytes, no YAML.

    Args:
        folder: Where it lies; what is not there is told by Hydra.
        config_name: Its name, with or without .yaml.

    Raises:
        ConfigError: It is one.
    """
    path = folder / config_name
    path = path if path.suffix in (".yaml", ".yml") else path.with_name(f"{path.name}.yaml")
    if is_there(path):
        read_settings(path, "")


def as_meant(words: Sequence[str]) -> list[str]:
    """Return overrides with null for a mirror without keys: Hydra merges keys, so that none of them change nothing."""
    return [_NO_MIRROR if _EMPTY_MIRROR.fullmatch(word) else word for word in words]


def with_environment(words: Sequence[str]) -> list[str]:
    """Put the choice of an environment's file before an id, or dynamics, typed without one, as the library chooses.

    An id takes the file of conf/env that names it, which is said on standard error. Whatever else is typed takes none:
    the names and the grammar of the environment that a run takes otherwise would stay.

    Args:
        words: The overrides of a command line, all of which `config.yaml` of conf/ takes.
    """
    ids = words_of(words, ("env.id", "env.dynamics"))
    if not ids or words_of(words, ("env", "experiment")):
        return list(words)
    typed = ids[-1].partition("=")[2].strip("'\"")
    choice, place = choice_of(typed), words.index(ids[0])
    there = [f"env={choice_of(one)}" for one in typed.split(",") if choice_of(one) != NO_ENVIRONMENT]
    if choice != NO_ENVIRONMENT:
        _say(
            f"{typed} takes names, grammar and settings of env={choice}; with env={NO_ENVIRONMENT} it takes none"
        )
    elif there:
        _say(
            f"ids that are swept over take no names, grammar and settings of their own; {' and '.join(there)} would"
        )
    # A plus would add what the file has already.
    plain = [word.lstrip("+") if word in ids else word for word in words]
    return [*plain[:place], f"env={choice}", *plain[place:]]


def _say(line: str) -> None:
    print(f"ge-torchrl: {line}", file=sys.stderr)


def words_of(words: Sequence[str], keys: Collection[str]) -> list[str]:
    """Return the overrides that set one of these keys, or choose a file of one of these groups."""
    return [word for word in words if word.partition("=")[0].lstrip("+").partition("@")[0] in keys]


def added_folder(config_dir: str, config_name: str) -> Path:
    """Return the folder of --config-dir, whose choices are offered beside those of conf/.

    Args:
        config_dir: The folder as it was typed.
        config_name: Name of the file that the configuration begins with.

    Raises:
        ConfigError: There is no such folder, or it holds a file of that name, which would not be read.
    """
    folder = Path(config_dir).resolve()
    if not folder.is_dir():
        raise ConfigError(f"--config-dir must be a folder with choices; got {config_dir}")
    name = Path(config_name).with_suffix(".yaml").name
    if (folder / name).is_file() and (CONF / name).is_file():
        raise ConfigError(
            f"--config-dir must be a folder with choices alone, because its {name} would not be read; "
            f"got {config_dir}; a run's {name} is read by --config-path {folder} --config-name {config_name}"
        )
    return folder


def config_from(composed: object) -> Config:
    """Return the configuration that files and overrides compose.

    Args:
        composed: Plain values, of mappings and lists.

    Raises:
        ConfigError: They are no sections with keys and values, or a value is not allowed.
    """
    if not isinstance(composed, dict):
        raise ConfigError(f"the configuration must be keys with values; got {type(composed).__name__}")
    check_sections(env := composed.get("env"))
    if isinstance(env, dict):
        # The key is there unless the user took it away: '~env.symmetry'.
        env.setdefault("symmetry", None)
    return Config.from_mapping({str(key): value for key, value in composed.items()})


def searched(config_dir: str | None, config_name: str) -> list[str]:
    """Return the override that makes Hydra look into the folder of --config-dir too; see `added_folder`."""
    if config_dir is None:
        return []
    quoted = str(added_folder(config_dir, config_name)).replace("'", r"\'")
    return [f"hydra.searchpath=['{quoted}']"]
