"""Settings declare type, range and meaning on the field; one check reads what was declared."""

import math
import types
from collections.abc import Mapping
from dataclasses import MISSING, Field, field, fields
from functools import cache
from typing import Any, ClassVar, Union, cast, get_args, get_origin

from ge_torchrl.checks import MOST, MOST_EPISODES, UNSET, Kind, Rule, checked, refuse

REQUIRED = MISSING
NOT_BY_SPEED = object()
"""Instead of a value for dear steps: the setting does not follow the environment's speed."""
_KINDS: dict[type, Kind] = {int: "integer", float: "number", bool: "flag", str: "text", Mapping: "mapping"}


def setting(
    default: Any = REQUIRED,
    *,
    doc: str,
    at_least: float = -math.inf,
    above: float = -math.inf,
    at_most: float = math.inf,
    choices: tuple[str, ...] = (),
    distinct: bool = False,
    because: str = "",
    text: str = "a text",
    renamed: tuple[tuple[str, str], ...] = (),
    lines: bool = False,
    largest: int = MOST,
    dear: Any = NOT_BY_SPEED,
) -> Any:
    """Declare a setting; type and whether null is allowed are those of the annotation.

    A setting with `dear` follows the speed of the environment where the user leaves it open, that is, null: it is the
    default where steps are nearly free, and `dear` elsewhere (`Config.resolved`). Its annotation is that of the
    resolved value, which is all that a search ever sees.

    Args:
        default: The value where none is given; without it the user has to give one.
        doc: What it means: one or two sentences for `docs/settings.md`.
        at_least: See `checks.Rule`, as for all others.
        above: Numbers have to be larger than this.
        at_most: The largest number allowed.
        choices: The texts allowed.
        distinct: Whether the texts of a list have to differ.
        because: Why the range is what it is.
        text: What a text is.
        renamed: Former texts and what they are called now.
        lines: Whether a text may have several lines.
        largest: The largest number allowed where no range names one.
        dear: The value where steps of the environment are dear.
    """
    declared = {
        "at_least": at_least,
        "above": above,
        "at_most": at_most,
        "choices": choices,
        "distinct": distinct,
        "because": because,
        "text": text,
        "renamed": renamed,
        "lines": lines,
        "largest": largest,
    }
    metadata = {"doc": doc, "declared": declared, "dear": dear}
    return field(metadata=metadata) if default is REQUIRED else field(default=default, metadata=metadata)


def mapping(*, doc: str, example: str) -> Any:
    """Declare a setting that is keys with values of the user's own, by default none: what JSON can say."""
    # A mapping has no hash; records that differ in it alone are unequal, and that is enough.
    metadata = {"doc": doc, "declared": {"text": example}, "dear": NOT_BY_SPEED}
    return field(default_factory=dict, hash=False, metadata=metadata)


def probability(default: float, *, doc: str, because: str = "it is a probability") -> Any:
    """Declare a setting that is a number from 0 to 1."""
    return setting(default, doc=doc, at_least=0.0, at_most=1.0, because=because)


def episode_count(
    default: int, *, doc: str, because: str, at_least: int = 1, dear: int | object = NOT_BY_SPEED
) -> Any:
    """Declare a setting that counts episodes; see `setting`."""
    return setting(
        default,
        at_least=at_least,
        at_most=MOST_EPISODES,
        because=f"{because}, and memory holds what every tree returned in each",
        dear=dear,
        doc=doc,
    )


class Section:
    """A frozen record of settings, checked field by field where it is made, then as a whole (`check_together`).

    A subclass is a frozen dataclass whose `SECTION` begins its keys.
    """

    SECTION: ClassVar[str]

    def __post_init__(self) -> None:
        for entry in fields(cast("Any", self)):
            value = getattr(self, entry.name)
            if record := nested(entry):
                if not isinstance(value, record):
                    refuse(self.key(entry.name), value, f"a {record.__name__}")
                continue
            # Within __post_init__ a frozen record may still be completed; afterwards nobody writes to it.
            object.__setattr__(self, entry.name, checked(self.key(entry.name), value, rule_of(entry)))
        self.check_together()

    def check_together(self) -> None:
        """Refuse settings that are allowed one by one but not together."""

    @classmethod
    def key(cls, name: str) -> str:
        """Return what the user calls a field, such as `ge.population_size`."""
        return f"{cls.SECTION}.{name}" if cls.SECTION else name

    def refuse(self, name: str, expected: str, because: str = "", instead: object = None) -> None:
        """Refuse the value of a field, and say what to type `instead` where there is one thing to type."""
        hint = "" if instead is None else f"type {self.key(name)}={instead}"
        refuse(self.key(name), getattr(self, name), expected, because, hint)


def nested(entry: Field[Any]) -> type[Section] | None:
    """Return the record that a field holds, if it holds one."""
    return entry.type if isinstance(entry.type, type) and issubclass(entry.type, Section) else None


def default_of(entry: Field[Any]) -> Any:
    """Return the default of a setting: `UNSET` where the user has to give one, null where it follows the speed."""
    if follows_speed(entry):
        return None
    if holds_mapping(entry):
        return {}
    return UNSET if entry.default is MISSING else entry.default


def follows_speed(entry: Field[Any]) -> bool:
    """Tell whether a setting that is left open follows the speed of the environment."""
    return entry.metadata.get("dear", NOT_BY_SPEED) is not NOT_BY_SPEED


def holds_mapping(entry: Field[Any]) -> bool:
    """Tell whether a setting is keys with values of the user's own."""
    return rule_of(entry).kind == "mapping"


@cache
def rule_of(entry: Field[Any]) -> Rule:
    """Return what a setting allows: its annotation and what was declared with it."""
    kind, many, optional = _read(entry.type)
    optional = optional or follows_speed(entry)
    return Rule(kind=kind, many=many, optional=optional, **entry.metadata["declared"])


def _read(annotation: Any) -> tuple[Kind, bool, bool]:
    optional = get_origin(annotation) in (types.UnionType, Union)
    if optional:
        (annotation,) = (part for part in get_args(annotation) if part is not type(None))
    if get_origin(annotation) is Mapping:
        return _KINDS[Mapping], False, optional
    many = get_origin(annotation) is tuple
    return _KINDS[get_args(annotation)[0] if many else annotation], many, optional
