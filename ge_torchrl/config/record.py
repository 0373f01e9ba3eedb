"""Everything that a run depends on as one frozen record, and its way from nested plain values and back."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields
from functools import cache
from typing import Any, ClassVar

from ge_torchrl.checks import MOST_EPISODES, UNSET
from ge_torchrl.config import keys
from ge_torchrl.config.archive import ArchiveConfig
from ge_torchrl.config.environment import EnvironmentConfig
from ge_torchrl.config.refinement import PolishConfig, RefinerConfig
from ge_torchrl.config.sections import EvaluationConfig, GEConfig, GrammarConfig
from ge_torchrl.config.setting import Section, default_of, follows_speed, holds_mapping, nested, setting
from ge_torchrl.config.starts import StartsConfig
from ge_torchrl.errors import ConfigError

# From so many environment steps a second on, steps are nearly free: kernels make a hundred times as many, and anything
# else a tenth.
_NEARLY_FREE = 1e6
# What a run may take where steps are dear and nobody set a limit [s].
_DEAR_SECONDS = 180
# All races of dense starts together may take this part of what a run may take, and one of them so many steps where
# steps are nearly free.
_RACES_SHARE, _RACE_STEPS = 0.6, 3_000_000
# A return and a length of an episode take so many bytes, and the episodes of one measurement may take so many.
_EPISODE_BYTES, _MOST_BYTES = 16, 8 << 30
# How many trees go on from the archive, in one way or another.
_PROPOSALS = ("neighbours", "revisit_factor", "migrants", "final_keep")


@dataclass(frozen=True)
class Config(Section):
    """Everything that a run depends on; the same record gives the same results."""

    SECTION: ClassVar[str] = ""

    env: EnvironmentConfig
    grammar: GrammarConfig
    ge: GEConfig = field(default_factory=GEConfig)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)
    refiner: RefinerConfig = field(default_factory=RefinerConfig)
    polish: PolishConfig = field(default_factory=PolishConfig)
    archive: ArchiveConfig = field(default_factory=ArchiveConfig)
    starts: StartsConfig = field(default_factory=StartsConfig)
    seed: int = setting(
        0,
        at_least=0,
        because="seeds of random numbers are not negative",
        largest=2**64 - 1,
        doc="The one seed from which all randomness of the run follows.",
    )
    logger: str = setting(
        "none",
        choices=("none", "csv", "tensorboard", "wandb", "mlflow"),
        doc="A tracker that is told of every generation and of the verdict, by TorchRL's loggers; what it writes "
        "lies in the run's folder. `tensorboard` and `wandb` need the extra `trackers`, `mlflow` the extra `mlflow`. "
        "One that fails is left out, and the run goes on.",
    )

    def check_together(self) -> None:
        """Refuse episodes that fit into no memory: those of many trees at once, and multiples of many."""
        n_trees = max(_at_most(self.ge, "population_size"), _at_most(self.archive, "neighbours_drawn"))
        if n_trees * _at_most(self.evaluation, "episodes") * _EPISODE_BYTES > _MOST_BYTES:
            at_most = max(1, _MOST_BYTES // (n_trees * _EPISODE_BYTES))
            self.evaluation.refuse(
                "episodes",
                f"at most {at_most} where {n_trees} trees are measured at once",
                f"an episode of a tree takes {_EPISODE_BYTES} bytes, and {_MOST_BYTES >> 30} GiB are allowed",
                at_most,
            )
        for factor in ("revisit_factor", "final_factor"):
            times = _at_most(self.archive, factor)
            for section, name in ((self.polish, "episodes"), (self.refiner.ppo, "snapshot_episodes")):
                if times * _at_most(section, name) > MOST_EPISODES:
                    self._refuse_times(section, name, factor, times)

    def _refuse_times(self, section: Section, name: str, factor: str, times: int) -> None:
        because = f"no tree is measured on more than {MOST_EPISODES} episodes"
        if times > MOST_EPISODES:
            self.archive.refuse(factor, f"at most {MOST_EPISODES}", because)
        key = self.archive.key(factor)
        section.refuse(
            name, f"at most {MOST_EPISODES // times} with {key}={times}", because, MOST_EPISODES // times
        )

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> "Config":
        """Return the record of nested plain values, as they come from YAML.

        Args:
            values: Sections and keys; what is left out takes its default.

        Raises:
            ConfigError: A key is unknown or has no value, or a value is of the wrong type or out of its range.
        """
        record: Config = _record_from(cls, values)
        return record

    def as_mapping(self) -> dict[str, Any]:
        """Return nested plain values, ready for YAML or JSON; `from_mapping` takes them back."""
        plain: dict[str, Any] = _plain(asdict(self))
        return plain

    def resolved(self, steps_per_second: float, *, has_sums: bool = False) -> "Config":
        """Return the configuration with everything that was left open decided by the environment's speed.

        Args:
            steps_per_second: Environment steps a second of small trees.
            has_sums: Whether the grammar weighs features, so that dense starts are raced.
        """
        free = steps_per_second >= _NEARLY_FREE
        values = _decided(self, free=free)
        is_refined = self.refiner.enabled or values["polish"]["every"] > 0
        if values["archive"]["keep"] == 0 or not is_refined:
            values["archive"] |= dict.fromkeys(_PROPOSALS, 0)
        if values["archive"]["keep"] == 0:
            values["archive"]["races"] = 0
        most = self.starts.max_env_steps if has_sums else None
        if self.ge.max_env_steps and most is not None:
            values["ge"]["max_env_steps"] = min(most, self.ge.max_env_steps)
        elif self.ge.max_env_steps is not None or self.ge.max_seconds is not None:
            pass  # As it was asked for.
        elif most is not None:
            values["ge"]["max_env_steps"] = most
        elif not free:
            values["ge"]["max_env_steps"] = max(1, int(float(f"{_DEAR_SECONDS * steps_per_second:.2g}")))
        if self.starts.max_timesteps is None:
            values["starts"]["max_timesteps"] = self._race_steps(values["ge"], steps_per_second, free=free)
        values["evaluation"]["steps_per_second"] = float(f"{steps_per_second:.2g}")
        return Config.from_mapping(values)

    def _race_steps(self, ge: Mapping[str, Any], steps_per_second: float, *, free: bool) -> int:
        """Return the environment steps of a race of dense starts."""
        if free or self.starts.races == 0:
            return _RACE_STEPS
        seconds = ge["max_seconds"] or _DEAR_SECONDS
        steps = min(ge["max_env_steps"] or math.inf, seconds * steps_per_second)
        return max(1, int(float(f"{_RACES_SHARE / self.starts.races * steps:.2g}")))


def _at_most(section: Section, name: str) -> int:
    """Return a number of a section; left open, it is never more than where steps are nearly free."""
    value: int | None = getattr(section, name)
    return getattr(type(section), name) if value is None else value


def _decided(section: Section, *, free: bool) -> dict[str, Any]:
    """Return the values of a section, those that follow the speed decided."""
    values: dict[str, Any] = {}
    for entry in fields(section):  # type: ignore[arg-type]
        value = getattr(section, entry.name)
        if isinstance(value, Section):
            values[entry.name] = _decided(value, free=free)
        elif value is None and follows_speed(entry):
            values[entry.name] = entry.default if free else entry.metadata["dear"]
        else:
            values[entry.name] = _plain(value)
    return values


def template(record: type[Section] = Config) -> dict[str, Any]:
    """Return all keys with their defaults, nested as in `Config`, and `UNSET` where there is no default."""
    return {
        entry.name: template(inner) if (inner := nested(entry)) else _plain(default_of(entry))
        for entry in fields(record)  # type: ignore[arg-type]
    }


def check_key(key: str) -> None:
    """Refuse a dotted key, such as `ge.generations`, that no run has.

    Raises:
        ConfigError: There is no such key; the message names its successor or similar ones.
    """
    if not any(key.startswith(f"{own}.") for own in MAPPINGS):
        keys.check_key(key, _known_keys())


def similar_keys(key: str) -> list[str]:
    """Return the keys that a mistyped one, or the end of one, may stand for; none where none is near."""
    return [name for name in keys.similar(key, _known_keys()) if "." in name]


@cache
def _known_keys() -> tuple[str, ...]:
    return tuple(_flat_keys(template()))


def _mappings(record: type[Section]) -> Iterator[str]:
    """Return the settings whose keys are the user's own, such as `env.kwargs`."""
    for entry in fields(record):  # type: ignore[arg-type]
        if inner := nested(entry):
            yield from _mappings(inner)
        elif holds_mapping(entry):
            yield record.key(entry.name)


MAPPINGS = tuple(_mappings(Config))
"""The settings whose keys are the user's own."""


def _flat_keys(values: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    for name, value in values.items():
        yield prefix + name
        if isinstance(value, dict):
            yield from _flat_keys(value, f"{prefix}{name}.")


def _record_from(record: type[Section], values: object) -> Any:
    if not isinstance(values, Mapping):
        raise ConfigError(f"{record.SECTION} must be a section with keys and values; got {values!r}")
    for name in values:
        check_key(record.key(str(name)))
    given: dict[str, Any] = {}
    for entry in fields(record):  # type: ignore[arg-type]
        if inner := nested(entry):
            given[entry.name] = _record_from(inner, values.get(entry.name, {}))
        else:
            # The check refuses UNSET, so that a missing value is reported in the words of its key.
            given[entry.name] = values.get(entry.name, default_of(entry))
    return record(**given)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    return list(value) if isinstance(value, tuple) else value


__all__ = ["MAPPINGS", "UNSET", "Config", "check_key", "similar_keys", "template"]
