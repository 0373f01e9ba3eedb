"""The rule in a frame: its outline, the path that an observation takes lit, and what every split there compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ge_torchrl.play.episode import Moment
from ge_torchrl.play.ink import INK, LINE, LIT, LIT_LINE, QUIET, colour_of, ink_on
from ge_torchrl.play.lettering import Lettering, short
from ge_torchrl.play.outline import Folding, Row, outline
from ge_torchrl.trees.controller import Controller

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw

# Pixels.
_SIZES = (22, 20, 18, 17, 16, 15, 14, 13, 12)
# Lines are wrapped where letters would be smaller otherwise.
_UNWRAPPED_SIZE = 15
_INDENT, _PADDING = 30, 8
# The deepest row begins here at the latest, a part of the width.
_DEEPEST = 0.45


@dataclass(frozen=True)
class Box:
    """A rectangle of a frame [pixels]."""

    left: int
    top: int
    width: int
    height: int

    @property
    def right(self) -> int:
        """Where it ends."""
        return self.left + self.width


class DrawnRule:
    """Draws a rule into a box, as large as fits.

    Args:
        controller: The rule.
        box: Where it goes.
        lettering: Of all its texts.
    """

    def __init__(self, controller: Controller, box: Box, lettering: Lettering) -> None:
        self._tree, self._box, self._lettering = controller.tree, box, lettering
        self._rows = outline(controller)
        self._of_node = {row.node: place for place, row in enumerate(self._rows)}
        depth = max(row.depth for row in self._rows)
        self._indent = min(float(_INDENT), box.width * _DEEPEST / max(1, depth))
        for size in _SIZES:
            self._set(size)
            is_wrapped = any(len(lines) > 1 for texts in self._lines for lines in texts)
            if sum(self._heights) <= box.height and not (is_wrapped and size > _UNWRAPPED_SIZE):
                break
        self._folding = Folding(self._rows, self._heights, self._height(1))

    def draw(self, draw: ImageDraw, moment: Moment) -> None:
        """Draw the rule with the path of a moment lit."""
        values = {
            self._of_node[passed.split]: [f"{short(passed.value)}  {'yes' if passed.is_true else 'no'}"]
            for passed in moment.path
        }
        end = self._of_node[~moment.leaf]
        values[end] = [] if isinstance(moment.answer, int) else [short(entry) for entry in moment.answer]
        shown = self._folding.shown(list(values), self._box.height)
        top, tops = float(self._box.top), dict[int, float]()
        for place, is_folded in shown.items():
            tops[place] = top
            top += self._folding.height(place, is_folded=is_folded)
        # Lit lines lie over the others.
        for place in sorted(tops, key=lambda place: place in values):
            self._draw_edge(draw, place, tops, is_lit=place in values)
        for place, is_folded in shown.items():
            lines = [[self._folding.text(place)]] if is_folded else self._lines[place]
            self._draw_row(draw, self._rows[place], lines, tops[place], values.get(place))

    def _set(self, size: int) -> None:
        """Take letters of a size."""
        self._size, self._font = size, self._lettering.font(size)
        self._line, self._gap = round(size * 1.3), max(2, round(size * 0.35))
        self._values_width = round(self._font.getlength("-0.0000  yes")) + 2 * _PADDING
        self._branch_width = round(self._font.getlength("yes ")) + 4
        self._lines = [[self._wrapped(row, text) for text in row.texts] for row in self._rows]
        self._heights = [self._height(sum(map(len, texts))) for texts in self._lines]

    def _height(self, n_lines: int) -> int:
        return n_lines * self._line + 2 * self._gap

    def _left(self, row: Row) -> int:
        return self._box.left + round(row.depth * self._indent)

    def _text_left(self, row: Row) -> int:
        return self._left(row) + _PADDING + (self._branch_width if row.branch else 0)

    def _wrapped(self, row: Row, text: str) -> list[str]:
        """Return a text of a row in as many lines as its place needs."""
        room = self._box.right - self._values_width - self._text_left(row)
        return self._lettering.wrapped(text, self._size, room)

    def _draw_edge(self, draw: ImageDraw, place: int, tops: dict[int, float], *, is_lit: bool) -> None:
        """Draw the line from a row's parent to it."""
        row = self._rows[place]
        if row.parent < 0:
            return
        x = self._left(self._rows[row.parent]) + round(self._indent / 2)
        y = tops[place] + self._gap + self._line / 2
        above = tops.get(row.parent)
        start = self._box.top if above is None else above + self._heights[row.parent] - self._gap + 1
        colour, width = (LIT_LINE, 3) if is_lit else (LINE, 1)
        draw.line([(x, start), (x, y), (self._left(row), y)], fill=colour, width=width)

    def _draw_row(
        self,
        draw: ImageDraw,
        row: Row,
        lines: Sequence[Sequence[str]],
        top: float,
        values: Sequence[str] | None,
    ) -> None:
        """Draw a row; one that is lit has values, each beside the first line of its text."""
        first, middle = top + self._gap, self._line / 2
        ink = QUIET if values is None else self._draw_lit(draw, row, lines, first)
        if row.branch:
            place = (self._left(row) + _PADDING, first + middle)
            draw.text(place, row.branch, fill=ink, font=self._font, anchor="lm")
        y = first + middle
        for i, of_text in enumerate(lines):
            if values and i < len(values):
                place = (self._box.right - _PADDING, y)
                draw.text(place, values[i], fill=LIT_LINE, font=self._font, anchor="rm")
            for line in of_text:
                draw.text((self._text_left(row), y), line, fill=ink, font=self._font, anchor="lm")
                y += self._line
        if values is None and row.node < 0 and self._tree.has_actions:
            self._draw_swatch(draw, row, self._text_left(row) + self._font.getlength(lines[0][0]) + 10, first)

    def _draw_lit(self, draw: ImageDraw, row: Row, lines: Sequence[Sequence[str]], first: float) -> str:
        """Draw what lies behind a row on the path; return the colour of what is written there."""
        fill, right = LIT, self._box.right
        if row.node < 0 and self._tree.has_actions:
            fill = colour_of(int(self._tree.action[~row.node]))
            longest = max(self._font.getlength(line) for line in lines[0])
            right = self._text_left(row) + round(longest) + _PADDING
        bottom = first + sum(map(len, lines)) * self._line + 1
        draw.rounded_rectangle((self._left(row), first - 2, right, bottom), 5, fill=fill, outline=LIT_LINE)
        return ink_on(fill) if fill != LIT else INK

    def _draw_swatch(self, draw: ImageDraw, row: Row, left: float, top: float) -> None:
        side = round(self._size * 0.6)
        y = top + (self._line - side) / 2
        colour = colour_of(int(self._tree.action[~row.node]))
        draw.rectangle((left, y, left + side, y + side), fill=colour, outline=LINE)
