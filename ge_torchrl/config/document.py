"""The page of all settings, `docs/settings.md`, written from what the records declare.

`make settings` writes it anew.
"""

from collections.abc import Iterator
from dataclasses import Field, fields, replace
from typing import Any

from ge_torchrl.checks import UNSET, Rule
from ge_torchrl.config.record import Config
from ge_torchrl.config.setting import Section, default_of, follows_speed, nested, rule_of

_HEAD = """\
# Settings

Every setting has a key, such as `ge.generations`, which is changed on the command line:

    python -m ge_torchrl env=acrobot ge.generations=40 seed=3

Where two defaults stand, the first is for environments whose steps are nearly free, a million a second and more, as
compiled kernels make them, and the second for all others. The run measures the speed at its start and writes what it
took to its `config.yaml`; the value `null` leaves such a key open again.

`conf/env/NAME.yaml` has what differs for one environment, and `python -m ge_torchrl env=NAME --cfg job` shows it
together with all the rest. The words `env=`, `grammar=`,
`archive=`, `polish=`, `refiner=` and `experiment=` choose a file of `conf/`, which sets several keys at once.

This page is written by `make settings`; do not edit it.
"""


def settings_page() -> str:
    """Return the page as Markdown."""
    return "\n".join([_HEAD, *_sections(Config)])


def _sections(record: type[Section]) -> Iterator[str]:
    entries: tuple[Field[Any], ...] = fields(record)  # type: ignore[arg-type]
    own = [entry for entry in entries if nested(entry) is None]
    if own:
        yield f"## {f'`{record.SECTION}`' if record.SECTION else 'The run'}\n"
        if record.SECTION:
            yield f"{meaning(record)}\n"
        yield "| key | default | allowed | meaning |\n|---|---|---|---|"
        yield from (_row(record, entry) for entry in own)
        yield ""
    for entry in entries:
        if inner := nested(entry):
            yield from _sections(inner)


def meaning(record: type[Section]) -> str:
    """Return what a section is about."""
    paragraphs = (record.__doc__ or "").split("\n\n")
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs)


def _row(record: type[Section], entry: Field[Any]) -> str:
    cells = (
        f"`{record.key(entry.name)}`",
        default(entry),
        allowed(rule_of(entry)),
        entry.metadata["doc"],
    )
    return f"| {' | '.join(cell.replace('|', '&#124;') for cell in cells)} |"


def default(entry: Field[Any]) -> str:
    """Return the default of a setting in words, or both where it follows the speed."""
    if follows_speed(entry) and entry.metadata["dear"] != entry.default:
        return f"{_shown(entry.default)} or {_shown(entry.metadata['dear'])}"
    value = default_of(entry)
    return "none: to be given" if value == UNSET else _shown(value)


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return f"`[{', '.join(map(str, value))}]`"
    return f"`{'null' if value is None else str(value).lower() if isinstance(value, bool) else value}`"


def allowed(rule: Rule) -> str:
    """Return what is allowed, without the article of a message."""
    if rule.choices:
        return ", ".join(f"`{choice}`" for choice in rule.choices)
    expected = replace(rule, optional=False).expected
    for article in ("a finite ", "an ", "a "):
        expected = expected.removeprefix(article)
    return f"{expected.replace(' of at least', ', at least')}{', or null' if rule.optional else ''}"


if __name__ == "__main__":
    print(settings_page(), end="")
