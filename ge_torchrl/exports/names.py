"""Names of features and actions as other languages allow them."""

from __future__ import annotations

import unicodedata
from collections.abc import Collection, Sequence
from dataclasses import replace

from ge_torchrl.trees.controller import Controller

# Compilers compare so many characters at least.
_LONGEST = 48
_DOT_ABOVE = "\u0307"


def identifiers(names: Sequence[str], role: str, reserved: Collection[str]) -> tuple[str, ...]:
    """Return a legal identifier for each name, all of them different, even where case does not count.

    Args:
        names: The names, of any characters.
        role: What they name, such as "feature"; it stands in front where a name does not begin with a letter.
        reserved: Words that the language keeps for itself, and identifiers that are taken, in lower case.

    Returns:
        Letters, digits and single underscores of ASCII, a letter first: `theta_dot` for `θ̇`, `lambda_value` for
        `lambda`.
    """
    used = set(reserved)
    found = []
    for place, name in enumerate(names):
        plain = _plain(name)
        if not plain[:1].isalpha():
            plain = f"{role}_{plain or place}"
        if plain.lower() in reserved:
            plain += "_value"
        identifier, count = plain, 1
        while identifier.lower() in used:
            count += 1
            identifier = f"{plain}_{count}"
        used.add(identifier.lower())
        found.append(identifier)
    return tuple(found)


def is_identifier(name: str, reserved: Collection[str]) -> bool:
    """Tell whether a name is one that `identifiers` could have returned."""
    return name[:1].isalpha() and _plain(name) == name and name.lower() not in reserved


def printable(text: str) -> str:
    """Return a text without line ends and other characters that steer a display: each becomes a space."""
    return "".join(character if character.isprintable() else " " for character in text)


def printably_named(controller: Controller) -> Controller:
    """Return the controller with names that can be printed in one line."""
    names = controller.names
    features, units, actions = (
        tuple(map(printable, texts)) for texts in (names.features, names.units, names.actions)
    )
    return replace(controller, names=replace(names, features=features, units=units, actions=actions))


def _plain(name: str) -> str:
    """Return what ASCII has of a name, words joined by underscores."""
    joined = "".join(map(_ascii, unicodedata.normalize("NFKD", name)))
    return "_".join(part for part in joined.split("_") if part)[:_LONGEST].rstrip("_")


def _ascii(character: str) -> str:
    if character.isascii():
        return character if character.isalnum() else "_"
    if character == _DOT_ABOVE:
        return "_dot"
    if unicodedata.combining(character):
        return ""
    script, _, letter = unicodedata.name(character, "").partition(" ")
    return letter.split()[-1].lower() if script == "GREEK" and "LETTER" in letter else "_"
