"""The jobs of a command line: one, or as many as the values of a sweep combine to."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ge_torchrl.artefacts.jobs import Words
from ge_torchrl.config import Config, check_group, check_key
from ge_torchrl.config.files import choices
from ge_torchrl.errors import ConfigError

FOLDERS = ("hydra.run.dir", "hydra.sweep.dir", "hydra.sweep.subdir")
"""Where Hydra makes the folders of runs."""

_MOST = 10_000


class Engine(NamedTuple):
    """What a job goes to that no launcher of Hydra's runs.

    Attributes:
        settings: Those of `hydra.launcher`.
        sweep: The sweep's folder.
        run: The folder of the run in it.
    """

    settings: Mapping[str, Any]
    sweep: Path
    run: str


class Job(NamedTuple):
    """A job of a command line.

    Attributes:
        words: What was typed for it, but Hydra's own.
        config: What they compose to.
        engine: None where a launcher of Hydra's runs it.
    """

    words: Words
    config: Config
    engine: Engine | None


def jobs_of(overrides: Sequence[Any], *, sweep: bool) -> Iterable[tuple[str, ...]]:
    """Return the overrides of every job: all combinations of the values that are swept over.

    Args:
        overrides: Hydra's.
        sweep: Whether these are jobs of a sweep: then words are those that Hydra hands to a job.

    Raises:
        ConfigError: There is no job, since a key has no value to take, or there are more than anybody waits for.
    """
    values = [_values(override, sweep=sweep) for override in overrides]
    if (n_jobs := math.prod(map(len, values))) > _MOST:
        raise ConfigError(f"a sweep must have at most {_MOST} jobs, because all are checked first; got more")
    if n_jobs == 0:
        empty = next(override for override, of in zip(overrides, values, strict=True) if not of)
        raise ConfigError(
            f"{empty.key_or_group} must have a value for each job of a sweep; got {empty.input_line}, which has none"
        )
    return itertools.product(*values)


def check_override(override: Any, *, sweep: bool) -> None:
    """Refuse an override that no job can take.

    Args:
        override: Hydra's.
        sweep: Whether there may be several jobs.

    Raises:
        ConfigError: It is one.
    """
    key = override.key_or_group
    if key in FOLDERS and not override.is_sweep_override() and override.value() in ("", None):
        raise ConfigError(
            f"{key} must be a folder, because a run leaves its files there; got {override.input_line}"
        )
    if override.is_sweep_override() and not sweep:
        raise ConfigError(f"{key} must be one value; got {override.input_line}; for a run of each, add -m")
    names_a_file = override.is_sweep_override() or override.is_delete() or isinstance(override.value(), str)
    if names_a_file:
        check_group(key)
    if (offered := choices(key)) and not names_a_file:
        raise ConfigError(f"{key} must be one of {', '.join(offered)}; got {override.get_value_string()}")
    # The other keys are Hydra's own, and its choices of files (group=choice, group/sub=choice, group@place=choice).
    if "/" not in key and key.partition(".")[0] not in ("hydra", "experiment"):
        check_key(key)


def _values(override: Any, *, sweep: bool) -> list[str]:
    key = override.get_key_element()
    if override.is_sweep_override():
        return [f"{key}={value}" for value in itertools.islice(override.sweep_string_iterator(), _MOST + 1)]
    if sweep and not override.is_delete():
        # What the grammar of Hydra knows as a sign is escaped here, as it is among values that are swept over.
        return [f"{key}={override.get_value_element_as_str()}"]
    return [str(override.input_line)]
