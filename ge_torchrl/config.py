"""The settings of a run as one frozen record, and the keys that users know it by.

What is allowed stands in `sections` and `refiner_section` and nowhere else, so a command line, a file and a
Python program are told the same things in the same words. A message names the full key, such as `ge.population_size`.
"""

import difflib
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, Field, asdict, dataclass, field, fields, is_dataclass
from typing import Any, ClassVar

from ge_torchrl.checks import UNSET, check_integer, refuse
from ge_torchrl.errors import ConfigError
from ge_torchrl.refiner_section import RefinerConfig
from ge_torchrl.sections import EnvironmentConfig, EvaluationConfig, GEConfig, GrammarConfig, HallOfFameConfig


@dataclass(frozen=True)
class Config:
    """Everything that a run depends on; the same record gives the same results.

    Attributes:
        env: The environment.
        grammar: The grammar.
        ge: Grammatical evolution.
        evaluation: Measuring trees.
        refiner: Refinement of trees.
        hall_of_fame: The best trees of each size.
        seed: The one seed from which all randomness of the run follows.
    """

    SECTION: ClassVar[str] = ""

    env: EnvironmentConfig
    grammar: GrammarConfig
    ge: GEConfig
    evaluation: EvaluationConfig
    refiner: RefinerConfig = field(default_factory=RefinerConfig)
    hall_of_fame: HallOfFameConfig = field(default_factory=HallOfFameConfig)
    seed: int = 0

    def __post_init__(self) -> None:
        for name, section in _SECTIONS.items():
            if not isinstance(getattr(self, name), section):
                refuse(self, name, f"a {section.__name__}")
        check_integer(self, "seed", 0, "seeds of random numbers are not negative")
        self._check_what_is_explored()

    def _check_what_is_explored(self) -> None:
        """Refuse exploring where it would silently be left out."""
        if self.refiner.enabled and self.hall_of_fame.enabled:
            return
        because = (
            "nothing is kept with hall_of_fame.enabled=false (hall_of_fame=none sets both)"
            if self.refiner.enabled
            else "nothing refines trees with refiner=none (hall_of_fame=kept or none explores nothing)"
        )
        for name in ("neighbours", "revisits", "final_keep", "migrants"):
            if getattr(self.hall_of_fame, name) > 0:
                refuse(self.hall_of_fame, name, "0", because)

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> "Config":
        """Return the record of nested plain values, as they come from YAML.

        Args:
            values: Sections and keys; what is left out takes its default.

        Raises:
            ConfigError: A key is unknown or has no value, or a value is of the wrong type or out of its
                range.
        """
        for name in values:
            check_key(str(name))
        sections = {name: _section_from(section, values.get(name, {})) for name, section in _SECTIONS.items()}
        return cls(**sections, **{name: value for name, value in values.items() if name not in _SECTIONS})

    def as_mapping(self) -> dict[str, Any]:
        """Return nested plain values, ready for YAML or JSON; `from_mapping` takes them back."""
        plain: dict[str, Any] = _plain(asdict(self))
        return plain


_SECTIONS: dict[str, type[Any]] = {
    section.SECTION: section
    for section in (
        EnvironmentConfig,
        GrammarConfig,
        GEConfig,
        EvaluationConfig,
        RefinerConfig,
        HallOfFameConfig,
    )
}


def template() -> dict[str, Any]:
    """Return all keys with their defaults, nested as in `Config`, and `UNSET` where there is no default."""
    return {
        entry.name: _defaults(_SECTIONS[entry.name]) if entry.name in _SECTIONS else entry.default
        for entry in fields(Config)
    }


def _defaults(section: type[Any]) -> dict[str, Any]:
    def default(entry: Field[Any]) -> Any:
        if nested := _nested(entry):
            return _defaults(nested)
        return UNSET if entry.default is MISSING else _plain(entry.default)

    return {entry.name: default(entry) for entry in fields(section)}


def _nested(entry: Field[Any]) -> type[Any] | None:
    """Return the record that a field holds, if it holds one."""
    factory: Any = entry.default_factory
    return factory if is_dataclass(factory) and isinstance(factory, type) else None


def check_key(key: str) -> None:
    """Refuse a dotted key, such as `ge.generations`, that no run has.

    Raises:
        ConfigError: There is no such key; the message offers similar ones.
    """
    known = list(_flat_keys(template()))
    if key in known:
        return
    siblings = [other for other in known if other.startswith(f"{key.partition('.')[0]}.")]
    similar = difflib.get_close_matches(key, siblings or known, n=3, cutoff=0.75)
    expected = similar or siblings or [name for name in known if "." not in name]
    raise ConfigError(f"{key} is unknown; expected a key of a run, such as {', '.join(expected)}; got {key}")


def _flat_keys(values: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    for name, value in values.items():
        yield prefix + name
        if isinstance(value, dict):
            yield from _flat_keys(value, f"{prefix}{name}.")


def _section_from(section: type[Any], values: object) -> Any:
    if not isinstance(values, Mapping):
        raise ConfigError(f"{section.SECTION} must be a section with keys and values; got {values!r}")
    for name in values:
        check_key(f"{section.SECTION}.{name}")
    # Every check refuses UNSET, so that a missing value is reported in the words of its key.
    required = {
        entry.name: UNSET for entry in fields(section) if entry.default is entry.default_factory is MISSING
    }
    nested = {
        entry.name: _section_from(record, values[entry.name])
        for entry in fields(section)
        if (record := _nested(entry)) and entry.name in values
    }
    return section(**{**required, **values, **nested})


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in value.items()}
    return list(value) if isinstance(value, tuple) else value
