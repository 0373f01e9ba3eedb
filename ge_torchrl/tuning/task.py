"""What a tuner is asked: which run, what may change in it, and how often it runs; kept beside the trials."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from rich.console import Console

from ge_torchrl.artefacts.texts import write_text
from ge_torchrl.config import Config
from ge_torchrl.environments.choose import open_backend
from ge_torchrl.errors import ArtefactError, ConfigError
from ge_torchrl.reading import is_there, json_of, read_text
from ge_torchrl.run.plan import plan
from ge_torchrl.run.warming import compile_kernels, is_first_of_its_kind
from ge_torchrl.search.fitness import Seeds
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.tuning.space import Dimension, Value, space_of
from ge_torchrl.version import __version__

TASK = "tuning.json"
# Where steps are nearly free a run has no limit of its own, and without one larger budgets would always be better.
_STEPS = 100_000_000
# Runs of a tuner have seeds that nobody types.
_SEEDS = (1 << 32, 1 << 62)


@dataclass(frozen=True)
class Task:
    """What a tuner is asked.

    Attributes:
        config: Of a run without tuning: with a limit, and with the speed that budgets follow.
        space: What may change.
        runs: Runs of each trial, of a seed each.
        words: What was typed of the run.
        config_dir: The folder of choices that was typed beside them; None for none.
    """

    config: Config
    space: tuple[Dimension, ...]
    runs: int
    words: tuple[str, ...]
    config_dir: str | None = None

    def with_values(self, values: Mapping[str, Value]) -> Config:
        """Return the configuration of a run with other values.

        Args:
            values: By their keys; what is left out stays untuned.

        Raises:
            ConfigError: They are not allowed together.
        """
        mapping = self.config.as_mapping()
        for key, value in values.items():
            *sections, name = key.split(".")
            node = mapping
            for section in sections:
                node = node[section]
            node[name] = value
        return Config.from_mapping(mapping)

    def rounded(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Return the values that a run takes, in the order of the space; those that are not given are untuned."""
        return {one.key: one.rounded(values.get(one.key, one.untuned)) for one in self.space}

    def seed_of(self, run: int) -> int:
        """Return the seed of the run of this number: the same in every trial, so that trials are compared on it."""
        return int(stream(self.config.seed, f"tuning, run {run}").integers(*_SEEDS))

    @property
    def limit(self) -> str:
        """What a run may take, in words."""
        ge = self.config.ge
        parts = [f"{ge.max_env_steps:,} steps"] if ge.max_env_steps else []
        parts += [f"{ge.max_seconds:g} s"] if ge.max_seconds else []
        return " and ".join(parts)


def tuning_seeds(config: Config) -> Seeds:
    """Return the episodes that judge a run of a tuner: drawn beside those of validation, and never of a test."""
    rng = stream(config.seed, "tuning episodes")
    return episode_seeds("validation", config.evaluation.test_episodes, rng)


def prepare(
    config: Config,
    texts: Sequence[str],
    pinned: Collection[str],
    runs: int,
    earlier: Task | None,
    console: Console,
) -> Task:
    """Return the task of a configuration; what depends on the clock is as in an earlier task of the same folder.

    Args:
        config: As it was composed.
        texts: What is to be tuned; see `space_of`.
        pinned: Keys that were typed with a value.
        runs: Runs of each trial.
        earlier: The task that the folder holds already; None for none.
        console: Is told where kernels are compiled.

    Raises:
        UserError: The configuration cannot be run, or the space is none.
    """
    planned = plan(config)
    known = earlier.config if earlier is not None else config
    with closing(
        open_backend(planned.spec, config.env.route, config.evaluation.threads, config.env.workers)
    ) as backend:
        if is_first_of_its_kind(planned):
            console.print("Compiling the kernels for this machine, once; this takes some seconds ...")
            compile_kernels(planned, backend.name)
        speed = known.evaluation.steps_per_second or float(f"{backend.steps_per_second:.2g}")
    resolved = planned.config.resolved(speed, has_sums=planned.tables.grammar.has_sums)
    ge = config.ge
    if not (ge.max_seconds or ge.max_env_steps):
        limit = earlier.config.ge.max_env_steps if earlier is not None else resolved.ge.max_env_steps
        ge = replace(ge, max_env_steps=limit or _STEPS)
    evaluation = replace(config.evaluation, steps_per_second=speed)
    space = space_of(texts, resolved, pinned)
    return Task(replace(config, ge=ge, evaluation=evaluation, logger="none"), space, runs, ())


def write_task(folder: Path, task: Task) -> None:
    """Write a task into its folder.

    Raises:
        ArtefactError: It cannot be written.
    """
    values = {
        "version": __version__,
        "words": task.words,
        "config_dir": task.config_dir,
        "runs": task.runs,
        "space": [asdict(one) for one in task.space],
        "config": task.config.as_mapping(),
    }
    write_text(folder / TASK, json.dumps(values, indent=2, ensure_ascii=False) + "\n")


def read_task(folder: Path) -> Task | None:
    """Return the task that a folder holds; None where it holds none.

    Raises:
        ArtefactError: The file is not in its format.
    """
    path = folder / TASK
    if not is_there(path):
        return None
    try:
        values = json_of(read_text(path))
        space = tuple(_dimension_from(entry) for entry in values["space"])
        return Task(
            Config.from_mapping(values["config"]),
            space,
            int(values["runs"]),
            tuple(map(str, values["words"])),
            values["config_dir"],
        )
    except (ValueError, TypeError, KeyError, AttributeError, ConfigError) as error:
        raise ArtefactError(
            f"{path} must be what tune writes; got something else ({' '.join(str(error).split())})"
        ) from error


def _dimension_from(values: dict[str, Any]) -> Dimension:
    return Dimension(**{**values, "choices": tuple(values["choices"])})


def check_same(folder: Path, asked: Task, earlier: Task) -> None:
    """Refuse to go on with a study of something else.

    Raises:
        ConfigError: The folder holds one.
    """
    others = {
        "--seeds": (asked.runs, earlier.runs),
        # A setting that is typed is not tuned, so these come before what is.
        "the settings": (asked.config, earlier.config),
        "--space": (
            {one.key: one.allowed for one in asked.space},
            {one.key: one.allowed for one in earlier.space},
        ),
    }
    for name, (now, before) in others.items():
        if now != before:
            typed = " ".join((*earlier.words, f"--seeds {earlier.runs}"))
            raise ConfigError(
                f"{folder} holds trials of another study, which differs in {name}, so expected what was typed for it "
                f"({typed}), or another folder; type --out NEW_FOLDER"
            )
