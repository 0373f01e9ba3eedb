"""Texts for terminals and pipes that cannot show every character."""

from __future__ import annotations

_PLAIN = str.maketrans({"├": "|", "└": "'", "─": "-", "│": "|", "±": "+-", "→": "->", "…": "...", "°": "deg"})


def printable(text: str, encoding: str | None) -> str:
    """Return a text in which every character can be written.

    Args:
        text: Any text.
        encoding: Of the stream that it goes to; None for ASCII.

    Returns:
        The text itself where the encoding has all of it; else lines drawn as `|-` and `'-`, and a question mark for
        what has no plain form.
    """
    encoding = encoding or "ascii"
    try:
        text.encode(encoding)
    except UnicodeEncodeError:
        return text.translate(_PLAIN).encode(encoding, errors="replace").decode(encoding)
    return text
