"""Which settings differ between runs, so that no table averages what was made by different ones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any

from ge_torchrl.config import Config

# A seed is what runs of one setting differ by, a logger only looks on, and the speed was measured.
_NO_SETTINGS = frozenset({"seed", "logger", "evaluation.steps_per_second"})
# They follow the measured speed where nobody set them, and it is never measured twice alike.
_FROM_SPEED = ("ge.max_env_steps", "starts.max_timesteps")
_LONGEST = 48


@cache
def settings_of(config: Config) -> Mapping[str, str]:
    """Return a configuration as texts by dotted key, without seed and measured speed."""
    return {key: value for key, value in _flat(config.as_mapping()) if key not in _NO_SETTINGS}


def differing(configs: Sequence[Config]) -> list[str]:
    """Return the keys whose values are not the same in all configurations, in the order of `Config`."""
    return _differing(compared(configs))


def labels_of(configs: Sequence[Config]) -> list[str]:
    """Return for each configuration what it has otherwise than others, as a person would type it.

    Equal labels mean equal settings: values too long to be shown whole are numbered where they look alike.

    Returns:
        Texts such as `ge.generations=50, refiner.method=none`; empty ones where nothing differs.
    """
    alike = compared(configs)
    keys = _differing(alike)
    of_text: dict[str, dict[tuple[str, ...], int]] = {}
    labels = []
    for settings in alike:
        whole = tuple(settings.get(key, "") for key in keys)
        text = ", ".join(f"{key}={_short(value)}" for key, value in zip(keys, whole, strict=True))
        number = of_text.setdefault(text, {}).setdefault(whole, len(of_text[text]) + 1)
        labels.append(text if number == 1 else f"{text} (another, {number})")
    return labels


def shown_setting(config: Config, key: str) -> str:
    """Return the value of a setting on one short line; "" where there is none of this name."""
    return _short(settings_of(config).get(key, ""))


def _short(value: str) -> str:
    line = " ".join(value.split())
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 1]}…"


def compared(configs: Sequence[Config]) -> list[Mapping[str, str]]:
    """Return the settings of configurations; where budgets differ that follow the measured speed, they are alike."""
    told = [dict(settings_of(config)) for config in configs]
    for key in _FROM_SPEED:
        if len({settings[key] for settings in told}) > 1:
            for config, settings in zip(configs, told, strict=True):
                if _follows_speed(config, key):
                    settings[key] = "by speed"
    return list(told)


def _differing(told: Sequence[Mapping[str, str]]) -> list[str]:
    keys = dict.fromkeys(key for settings in told for key in settings)
    return [key for key in keys if len({settings.get(key, "") for settings in told}) > 1]


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", "null" if value is None else str(value)


@cache
def _follows_speed(config: Config, key: str) -> bool:
    """Tell whether a budget is what the measured speed gives where nobody sets it."""
    section, name = key.split(".")
    speed, values = config.evaluation.steps_per_second, config.as_mapping()
    used = values[section][name]
    if speed is None or used is None:
        return False
    values[section] = {**values[section], name: None}
    left_open = Config.from_mapping(values)
    return any(
        left_open.resolved(speed, has_sums=has_sums).as_mapping()[section][name] == used
        for has_sums in (False, True)
    )
