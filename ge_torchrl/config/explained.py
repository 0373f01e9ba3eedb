"""What there is to say of a setting, from what the records declare and what the files of conf/ say."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import Field, dataclass, fields
from typing import Any

from ge_torchrl.checks import UNSET, Rule
from ge_torchrl.config.document import allowed, default, meaning
from ge_torchrl.config.files import choices, default_choices, read_choice
from ge_torchrl.config.record import Config, check_key
from ge_torchrl.config.setting import Section, default_of, nested, rule_of
from ge_torchrl.errors import ConfigError

# What to type for texts that are not one of a few.
_EXAMPLES = {
    "env.id": "LunarLander-v3",
    "env.dynamics": "docs/examples/plant.py:Cart",
    "env.wrappers": "[gymnasium.wrappers:FlattenObservation]",
    "env.features": "[x,x_dot,theta,theta_dot]",
    "env.units": "[m,m/s,rad,rad/s]",
    "env.actions": "[left,right]",
    "env.symmetry": "null",
    "grammar.bnf": "null",
    "grammar.splits": "oblique",
    "grammar.leaves": "linear",
    "grammar.name": "mine",
    "ge.max_seconds": "60",
    "evaluation.steps_per_second": "1e6",
    "refiner.schedule.generations": "[10,40]",
    "refiner.ppo.critic_hidden": "[64,64]",
}
_KEYS_OF_MAPPINGS = {"env.kwargs": ("env.kwargs.gravity", "-5")}
_BY_ENVIRONMENT = "${thesis:"


@dataclass(frozen=True)
class Explained:
    """A setting.

    Attributes:
        key: Such as `ge.generations`.
        meaning: What it means.
        allowed: What it may be.
        because: Why; may be empty.
        default: Its default, in words.
        presets: Choices of conf/ that set it, such as `env=acrobot`, with their values.
        example: An override to type.
    """

    key: str
    meaning: str
    allowed: str
    because: str
    default: str
    presets: tuple[tuple[str, str], ...]
    example: str


@dataclass(frozen=True)
class ExplainedSection:
    """A section of settings.

    Attributes:
        name: Such as `ge`; empty for the run itself.
        meaning: What it is about.
        keys: Its own keys with their defaults and meanings.
    """

    name: str
    meaning: str
    keys: tuple[Explained, ...]


def sections() -> Iterator[ExplainedSection]:
    """Yield every section with settings of its own, in the order of `docs/settings.md`."""
    presets = _presets()
    for record in _records(Config):
        keys = tuple(_explained(record, entry, presets) for entry in _own(record))
        if keys:
            yield ExplainedSection(record.SECTION, _plain(meaning(record)) if record.SECTION else "", keys)


def all_keys() -> Iterator[tuple[str, Rule]]:
    """Yield every key with what it allows."""
    for record in _records(Config):
        for entry in _own(record):
            yield record.key(entry.name), rule_of(entry)


def explained(key: str) -> Explained | ExplainedSection:
    """Return what there is to say of a key, or of a section.

    Args:
        key: Such as `ge.generations`, or `ge`; one below the user's own keys, `env.kwargs.gravity`, is that of these.

    Raises:
        ConfigError: There is none of this name; the message names similar ones.
    """
    for section in sections():
        if section.name and section.name == key:
            return section
        for setting in section.keys:
            if key == setting.key or (key.startswith(f"{setting.key}.") and setting.key in _KEYS_OF_MAPPINGS):
                return setting
    check_key(key)
    raise ConfigError(f"{key} is unknown; expected a section or a key that explain lists; got {key}")


def _records(record: type[Section]) -> Iterator[type[Section]]:
    yield record
    for entry in fields(record):  # type: ignore[arg-type]
        if inner := nested(entry):
            yield from _records(inner)


def _own(record: type[Section]) -> list[Field[Any]]:
    return [entry for entry in fields(record) if nested(entry) is None]  # type: ignore[arg-type]


def _explained(
    record: type[Section], entry: Field[Any], presets: Mapping[str, Mapping[str, Any]]
) -> Explained:
    key, rule = record.key(entry.name), rule_of(entry)
    set_in = {
        choice: value for choice, values in presets.items() if (value := _value_at(values, key)) is not UNSET
    }
    return Explained(
        key=key,
        meaning=_plain(entry.metadata["doc"]),
        allowed=_plain(allowed(rule)),
        because=rule.because,
        default=_plain(default(entry)),
        presets=tuple((choice, _typed(value)) for choice, value in set_in.items()),
        example=_example(key, entry, rule, list(set_in.values())),
    )


def _presets() -> dict[str, dict[str, Any]]:
    """Return what every file of conf/ says, by the words that choose it."""
    return {
        f"{group}={choice}": read_choice(group, choice)
        for group in default_choices()
        for choice in choices(group)
    }


def _value_at(values: Any, key: str) -> Any:
    """Return the value of a dotted key; `UNSET` where there is none."""
    for name in key.split("."):
        if not isinstance(values, Mapping) or name not in values:
            return UNSET
        values = values[name]
    return values


def _example(key: str, entry: Field[Any], rule: Rule, set_to: list[Any]) -> str:
    """Return an override that the setting takes, and that differs from its default where there is another."""
    if key in _KEYS_OF_MAPPINGS:
        return "=".join(_KEYS_OF_MAPPINGS[key])
    if key in _EXAMPLES:
        return _override(key, _EXAMPLES[key])
    usual = default_of(entry)
    own = entry.default if usual is None else usual
    numbers = (
        [10 * own, own / 2, 2 * own] if isinstance(own, int | float) and not isinstance(own, bool) else []
    )
    candidates = [
        *(value for value in set_to if not isinstance(value, str) or value in rule.choices),
        *rule.choices,
        *([not own] if rule.kind == "flag" else []),
        *reversed(numbers),
        *(1, 60, 0.5),
    ]
    found = next(
        value
        for value in candidates
        if value not in (None, usual, own) and rule.accepts(value) and not isinstance(value, Mapping)
    )
    return _override(key, _typed(rule.normalised(found)))


def _override(key: str, text: str) -> str:
    return f"{key}='{text}'" if set(text) & set("[]{} ") else f"{key}={text}"


def _typed(value: Any) -> str:
    """Return a value as it is typed; a text of several lines in short."""
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, str) and value.startswith(_BY_ENVIRONMENT):
        return f"{value.removeprefix(_BY_ENVIRONMENT).removesuffix('}')} (CartPole, Acrobot, MountainCar)"
    if isinstance(value, str):
        lines = value.strip().splitlines()
        return value if len(lines) < 2 else f"{lines[0].strip()} ... ({len(lines)} lines)"
    return json.dumps(value)


def _plain(text: str) -> str:
    """Return a text without the marks of Markdown."""
    return text.replace("`", "")
