"""What a tuner may change: settings, each with its range or its choices."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ge_torchrl.checks import Rule
from ge_torchrl.config import Config, check_key
from ge_torchrl.config.explained import all_keys
from ge_torchrl.config.files import read_settings
from ge_torchrl.errors import ConfigError
from ge_torchrl.reading import yaml_of

Value = float | int | str | bool | None

SPACE: Mapping[str, str] = MappingProxyType(
    {
        "ge.population_size": "x4",
        "ge.gene_probability": "0.005..0.5",
        "ge.crossover_probability": "",
        "ge.tournament_size": "2..8",
        "ge.parsimony": "",
        "evaluation.episodes": "x4",
        "refiner.schedule.every": "x4",
        "refiner.ppo.lr_actor": "x8",
        "refiner.ppo.lr_critic": "x8",
        "refiner.ppo.alpha": "x4",
        "refiner.ppo.max_timesteps": "x4",
        "archive.neighbours": "0..60",
        "polish.max_timesteps": "x8",
    }
)
"""What is tuned where nothing else is asked for: keys with ranges, as a user types them."""

# These decide what is compared, not how well it is found.
_FIXED = (
    "env.",
    "grammar.bnf",
    "grammar.name",
    "seed",
    "logger",
    "ge.max_",
    "ge.stop_when_solved",
    "evaluation.test_episodes",
    "evaluation.threads",
    "evaluation.steps_per_second",
)
_RANGE = re.compile(r"(\S+?)\s*\.\.\s*(\S+)")
_AROUND = re.compile(r"x(\d+(?:\.\d+)?)")
_UNDECLARED = "x4"
# A range that spans so much is searched by factors, not by differences.
_MANY_TIMES = 10
_DIGITS = 3
_EXPECTED = "a range such as 0.01..0.3, a factor such as x4 around its value, or choices such as a,b"


@dataclass(frozen=True)
class Dimension:
    """A setting that is tuned.

    Attributes:
        key: Such as `ge.tournament_size`.
        untuned: Its value without tuning.
        low: The least value; None where there are choices.
        high: The greatest one.
        is_integer: Whether it counts something.
        choices: Its values, where it has no range.
    """

    key: str
    untuned: Value
    low: float | None = None
    high: float | None = None
    is_integer: bool = False
    choices: tuple[Value, ...] = ()

    @property
    def is_log(self) -> bool:
        """Whether it is searched by factors."""
        return self.low is not None and self.high is not None and 0 < _MANY_TIMES * self.low <= self.high

    @property
    def holds_untuned(self) -> bool:
        """Whether the value without tuning is one of those that are tried."""
        if self.low is None or self.high is None:
            return self.untuned in self.choices
        return isinstance(self.untuned, int | float) and self.low <= self.untuned <= self.high

    @property
    def allowed(self) -> str:
        """The range or the choices, as they are typed."""
        if self.low is None or self.high is None:
            return ",".join(shown(choice) for choice in self.choices)
        return f"{self.low:.15g}..{self.high:.15g}"

    def rounded(self, value: Value) -> Value:
        """Return a value as a person writes it: of three figures, within the range."""
        if self.low is None or self.high is None or not isinstance(value, int | float):
            return value
        if self.is_integer:
            return int(value)
        return min(max(float(f"{value:.{_DIGITS}g}"), self.low), self.high)


def shown(value: Value) -> str:
    """Return a value as it is typed."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def space_of(texts: Sequence[str], untuned: Config, pinned: Collection[str]) -> tuple[Dimension, ...]:
    """Return what is to be tuned.

    Args:
        texts: What a user asks for: `KEY`, `KEY=0.01..0.3`, `KEY=x4`, `KEY=a,b`, or the path of a YAML file of keys;
            none takes `SPACE`, as far as it makes a difference to this run.
        untuned: The configuration without tuning, its budgets resolved.
        pinned: Keys that were typed with a value, which `SPACE` then leaves alone.

    Raises:
        ConfigError: A key is unknown, or cannot be tuned, or a range is none or not allowed.
    """
    values, rules = untuned.as_mapping(), dict(all_keys())
    if not texts:
        left = [key for key in SPACE if key not in pinned and _matters(key, untuned)]
        asked: dict[str, object] = {key: SPACE[key] for key in left}
        if not asked:
            raise ConfigError(
                "--space must name what is tuned, because every setting that is by default is given"
            )
    else:
        asked = dict(_asked(texts))
    return tuple(
        _dimension(key, text, value_at(values, _checked(key, rules)), rules[key])
        for key, text in asked.items()
    )


def check_keys(texts: Sequence[str]) -> None:
    """Refuse what cannot be tuned, before the environment is looked at; see `space_of`.

    Raises:
        ConfigError: There is something.
    """
    rules = dict(all_keys())
    for key, _ in _asked(texts):
        _checked(key, rules)


def value_at(values: Mapping[str, Any], key: str) -> Any:
    """Return the value of a dotted key in nested plain values; null where there is none."""
    node: Any = values
    for name in key.split("."):
        node = node.get(name) if isinstance(node, Mapping) else None
    return node


def _matters(key: str, config: Config) -> bool:
    """Tell whether a setting of `SPACE` makes a difference to a run."""
    refines, polishes = config.refiner.enabled, config.polish.every > 0
    needed = {
        "refiner.schedule.": refines,
        "refiner.ppo.": config.refiner.method == "ppo",
        "archive.": config.archive.enabled and (refines or polishes) and config.archive.neighbours > 0,
        "polish.": polishes or config.refiner.method == "cmaes",
    }
    return all(there for section, there in needed.items() if key.startswith(section))


def _asked(texts: Sequence[str]) -> Iterator[tuple[str, object]]:
    for text in texts:
        if text.endswith((".yaml", ".yml")):
            yield from read_settings(Path(text), "").items()
        else:
            key, equals, allowed = text.partition("=")
            yield key.strip(), allowed if equals else None


def _checked(key: str, rules: Mapping[str, Rule]) -> str:
    check_key(key)
    if key not in rules:
        raise ConfigError(f"--space must name settings, not a section of them; got {key}")
    if key.startswith(_FIXED):
        raise ConfigError(
            f"--space {key} cannot be tuned, because it decides what is compared; expected it as {key}=VALUE"
        )
    return key


def _dimension(key: str, asked: object, untuned: Value, rule: Rule) -> Dimension:
    """Return a setting with the range that is asked for: a text, a list of choices, or None for what is declared."""
    is_one = not rule.many and (rule.kind in ("integer", "number", "flag") or rule.choices)
    if not is_one:
        raise ConfigError(
            f"--space {key} cannot be tuned, because it is neither a number nor one of a few values"
        )
    if isinstance(asked, list):
        return _of_choices(key, asked, untuned, rule)
    text = str(asked).strip() if asked is not None else SPACE.get(key, "")
    if not text and (rule.choices or rule.kind == "flag"):
        return _of_choices(key, [*rule.choices] or [False, True], untuned, rule)
    if not text:
        is_declared = math.isfinite(rule.at_least) and math.isfinite(rule.at_most)
        text = f"{rule.at_least}..{rule.at_most}" if is_declared and rule.at_most <= 1 else _UNDECLARED
    if found := _RANGE.fullmatch(text):
        return _of_range(key, [found[1], found[2]], untuned, rule)
    if found := _AROUND.fullmatch(text):
        return _around(key, float(found[1]), untuned, rule)
    return _of_choices(key, [_read(key, part) for part in text.split(",")], untuned, rule)


def _of_choices(key: str, choices: Sequence[Any], untuned: Value, rule: Rule) -> Dimension:
    for choice in choices:
        if not (rule.accepts(choice) or (choice is None and rule.optional)):
            raise ConfigError(f"--space {key} must be {rule.expected}, or {_EXPECTED}; got {shown(choice)}")
    normal = [None if choice is None else rule.normalised(choice) for choice in choices]
    if len(set(normal)) < max(2, len(normal)):
        raise ConfigError(f"--space {key} must have two choices or more, each once; got {_joined(choices)}")
    return Dimension(key, untuned, choices=tuple(normal))


def _of_range(key: str, ends: Sequence[str], untuned: Value, rule: Rule) -> Dimension:
    got = "..".join(ends)
    if rule.kind not in ("integer", "number"):
        raise ConfigError(f"--space {key} must be choices, because it is no number; got {got}")
    low, high = (_read(key, end) for end in ends)
    if not (rule.accepts(low) and rule.accepts(high) and low < high):
        raise ConfigError(
            f"--space {key} must be a range within what the setting allows, {rule.expected}, the lesser end first; "
            f"got {got}"
        )
    return Dimension(key, untuned, rule.normalised(low), rule.normalised(high), rule.kind == "integer")


def _around(key: str, factor: float, untuned: Value, rule: Rule) -> Dimension:
    is_number = isinstance(untuned, int | float) and not isinstance(untuned, bool)
    if not isinstance(untuned, int | float) or not is_number or untuned <= 0 or factor <= 1:
        raise ConfigError(
            f"--space {key} must be a range such as 1..10, because its value, {shown(untuned)}, has nothing around it; "
            f"got x{factor:g}"
        )
    low = max(float(f"{untuned / factor:.{_DIGITS}g}"), rule.at_least)
    high = min(float(f"{untuned * factor:.{_DIGITS}g}"), rule.at_most)
    if rule.kind == "integer":
        low, high = max(1, math.floor(low)), math.ceil(high)
    return Dimension(key, untuned, low, high, rule.kind == "integer")


def _read(key: str, text: str) -> Any:
    try:
        value = float(text) if re.fullmatch(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+", text.strip()) else yaml_of(text)
    except ValueError:
        value = text
    if not isinstance(value, float | int | str | bool | None):
        raise ConfigError(f"--space {key} must be {_EXPECTED}; got {text}")
    return value


def _joined(choices: Sequence[Any]) -> str:
    return ",".join(map(shown, choices))
