"""Text that somebody else wrote, made fit for a terminal, for a line, and for a table in Markdown."""

import re

LONGEST_MESSAGE = 1000
"""A person reads no longer message; what a longer one says in its middle is left out."""
_LONGEST_NAME = 160
_LEFT_OUT = " ... "
# What Markdown or HTML would take for its own within a name.
_MARKDOWN = re.compile(r"[\\`*\[\]<>|]")


def printable(text: str) -> str:
    """Return a text in one line, without what a terminal would obey: escape codes, bells, turned writing."""
    if text.isprintable():
        return text
    return "".join(_shown(character) for character in text)


def message_of(text: str) -> str:
    """Return a message in one line that a person reads to its end."""
    return shortened(printable(text), LONGEST_MESSAGE)


def shortened(text: str, at_most: int = _LONGEST_NAME) -> str:
    """Return a text of so many characters at most, its middle left out; the end often says what to do."""
    if len(text) <= at_most:
        return text
    end = at_most // 3
    return f"{text[: at_most - end - len(_LEFT_OUT)]}{_LEFT_OUT}{text[-end:]}"


def said_of(error: BaseException) -> str:
    """Return what an error of somebody else's code says of itself, which may fail too."""
    try:
        return shortened(" ".join(repr(error).split()), LONGEST_MESSAGE // 2)
    except Exception:  # noqa: BLE001 - it is not ours.
        return type(error).__name__


def in_markdown(text: str) -> str:
    """Return a name as Markdown shows it: nothing in it is a tag, a link or a column."""
    return _MARKDOWN.sub(lambda found: f"\\{found[0]}", printable(text))


def _shown(character: str) -> str:
    if character.isprintable():
        return character
    return " " if character in "\n\r\t" else character.encode("unicode_escape").decode("ascii")
