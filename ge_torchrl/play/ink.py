"""Colours of frames, and what is said where a package is missing that draws or writes them."""

from __future__ import annotations

from importlib.util import find_spec

from ge_torchrl.errors import UserError
from ge_torchrl.report.drawing import ACTION_COLOURS

PAPER, INK, QUIET, LINE = "#FFFFFF", "#16191D", "#5F6773", "#C3C9D2"
LIT, LIT_LINE = "#D9EAF7", "#0072B2"
COLOURS = (PAPER, INK, QUIET, LINE, LIT, LIT_LINE, *ACTION_COLOURS)
"""Those that stand for something."""

# On a colour of this luminance black and white are read equally well.
_EVEN_LUMINANCE = 0.18


def needs(module: str, package: str, what: str) -> None:
    """Refuse to go on without a package.

    Args:
        module: What is imported.
        package: Its name where packages are installed from.
        what: What needs it, in the words of the message.

    Raises:
        UserError: It is not installed.
    """
    if find_spec(module) is None:
        raise UserError(
            f'{what} needs {package}; expected it installed: pip install -c constraints.txt -e ".[play]"'
        )


def colour_of(action: int) -> str:
    """Return the colour of an action, as in drawn trees."""
    return ACTION_COLOURS[action % len(ACTION_COLOURS)]


def ink_on(colour: str) -> str:
    """Return black or white, whichever is read better on a colour."""
    red, green, blue = (_linear(int(colour[i : i + 2], 16) / 255) for i in (1, 3, 5))
    luminance = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    return INK if luminance > _EVEN_LUMINANCE else PAPER


def _linear(channel: float) -> float:
    return channel / 12.92 if channel <= 0.03928 else ((channel + 0.055) / 1.055) ** 2.4
