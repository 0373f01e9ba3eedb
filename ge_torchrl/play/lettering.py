"""Texts that fit: fonts, lines, and numbers in few digits. Pillow is an extra, and is imported where it is needed."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING

from ge_torchrl.trees.controller import Names

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont, ImageFont

# Names in letters that Pillow's own font lacks are drawn with this one, where it is installed.
_OTHER_FONT = "DejaVuSans.ttf"
_OF_PILLOWS_FONT = "latin-1"
_LEFT_OUT = "..."


class Lettering:
    """The letters of all that is written about an environment.

    Args:
        names: What is written.
    """

    def __init__(self, names: Names) -> None:
        texts = "".join([*names.features, *names.units, *names.actions, names.environment])
        try:
            texts.encode(_OF_PILLOWS_FONT)
        except UnicodeEncodeError:
            self._is_latin = False
        else:
            self._is_latin = True

    def font(self, size: int) -> FreeTypeFont | ImageFont:
        """Return the font of a size [pixels]."""
        return _font(size, is_latin=self._is_latin)

    def width(self, text: str, size: int) -> float:
        """Return the width of a text [pixels]."""
        return self.font(size).getlength(text)

    def cut(self, text: str, size: int, room: float) -> str:
        """Return a text that fits into so many pixels; its middle is left out where it has to be."""
        if self.width(text, size) <= room:
            return text
        # The ends of names tell them apart.
        for kept in range(len(text) - 1, 1, -1):
            shorter = text[: (kept + 1) // 2] + _LEFT_OUT + text[len(text) - kept // 2 :]
            if self.width(shorter, size) <= room:
                return shorter
        return text[:1]

    def wrapped(self, text: str, size: int, room: float) -> list[str]:
        """Return a text in lines that fit into so many pixels, broken between words."""
        lines = [""]
        for word in text.split(" "):
            longer = f"{lines[-1]} {word}".lstrip()
            if lines[-1] and self.width(longer, size) > room:
                lines.append(word)
            else:
                lines[-1] = longer
        return [self.cut(line, size, room) for line in lines]

    def fitting(self, text: str, sizes: Sequence[int], room: float) -> int:
        """Return the first of these sizes at which a text fits, or the last."""
        return next((size for size in sizes if self.width(text, size) <= room), sizes[-1])


@cache
def _font(size: int, *, is_latin: bool) -> FreeTypeFont | ImageFont:
    from PIL import ImageFont

    if not is_latin:
        try:
            return ImageFont.truetype(_OTHER_FONT, size)
        except OSError:
            pass  # Boxes stand for the letters then.
    return ImageFont.load_default(size)


def short(value: float) -> str:
    """Return a number in few digits, of a width that hardly changes from one to the next: -0.0132, 12.4, 1.2e-07."""
    if value == 0:
        return "0"
    if 1e-4 <= abs(value) < 1e5:
        decimals = 0 if abs(value) >= 1000 else 2 if abs(value) >= 10 else 3 if abs(value) >= 0.1 else 4
        return f"{value:.{decimals}f}"
    return f"{value:.1e}"
