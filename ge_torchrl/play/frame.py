"""A frame: the environment's picture, what is observed and done, and the rule beside them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ge_torchrl.play.episode import Moment
from ge_torchrl.play.ink import INK, LINE, PAPER, QUIET, colour_of, ink_on
from ge_torchrl.play.lettering import Lettering, short
from ge_torchrl.play.rule import Box, DrawnRule
from ge_torchrl.play.traces import Traces
from ge_torchrl.trees.controller import Controller

if TYPE_CHECKING:
    from PIL.Image import Image
    from PIL.ImageDraw import ImageDraw

SIZE = (1280, 720)
"""Width and height of a frame [pixels]; both even, as films need it."""

_MARGIN, _TITLE = 24, 52
_SCENE = Box(_MARGIN, _TITLE + 8, 540, 392)
_FIGURES = Box(_MARGIN, _SCENE.top + _SCENE.height + 16, 540, 64)
_VALUES = Box(_MARGIN, _FIGURES.top + 74, 540, SIZE[1] - _FIGURES.top - 74 - 16)
_RULE = Box(596, _TITLE + 12, SIZE[0] - 596 - _MARGIN, SIZE[1] - _TITLE - 12 - _MARGIN)
# Where step, return and action begin.
_STEP, _RETURN, _ACTION = (_MARGIN + x for x in (0, 130, 290))
_ROW = 24
_SIZES = (26, 20, 16, 13)


class Stage:
    """Draws the moments of one episode.

    Args:
        controller: The rule.
        seed: Of the episode.
        traces: Draws what is observed over time, in place of a picture; None where the environment draws itself.
    """

    def __init__(self, controller: Controller, seed: int, traces: Traces | None) -> None:
        self._names, self._seed, self._traces = controller.names, seed, traces
        self._letters = Lettering(controller.names)
        self._rule = DrawnRule(controller, _RULE, self._letters)
        self._used = set(_used(controller))
        self._features = features_in_order(controller)

    def frame(self, moment: Moment) -> Image:
        """Return the frame of a moment, RGB."""
        from PIL import Image, ImageDraw

        image = Image.new("RGB", SIZE, PAPER)
        draw = ImageDraw.Draw(image)
        self._draw_title(draw)
        if self._traces is not None:
            self._traces.draw(draw, _SCENE, moment, self._letters)
        elif moment.picture is not None:
            draw.rectangle(_paste(image, Image.fromarray(moment.picture)), outline=LINE)
        self._draw_figures(draw, moment)
        self._draw_values(draw, moment)
        self._rule.draw(draw, moment)
        return image

    def _write(
        self,
        draw: ImageDraw,
        place: tuple[float, float],
        text: str,
        size: int,
        ink: str = INK,
        anchor: str = "lm",
    ) -> None:
        draw.text(place, text, fill=ink, font=self._letters.font(size), anchor=anchor)

    def _draw_title(self, draw: ImageDraw) -> None:
        middle, right = _TITLE / 2 + 2, SIZE[0] - _MARGIN
        title = self._letters.cut(self._names.environment, 22, right - _MARGIN - 200)
        self._write(draw, (_MARGIN, middle), title, 22)
        self._write(draw, (right, middle), f"seed {self._seed}", 17, QUIET, "rm")
        draw.line((_MARGIN, _TITLE, right, _TITLE), fill=LINE)

    def _draw_figures(self, draw: ImageDraw, moment: Moment) -> None:
        """Draw step, return and action, each below a small title."""
        middle = _FIGURES.top + 38
        last = "episode" if moment.ended else "action"
        for left, title in ((_STEP, "step"), (_RETURN, "return"), (_ACTION, last)):
            self._write(draw, (left, _FIGURES.top), title, 15, QUIET, "la")
        self._write(draw, (_STEP, middle), f"{moment.step:,}", 26)
        total = f"{moment.total:,.2f}".removesuffix(".00")
        size = self._letters.fitting(total, _SIZES, _ACTION - _RETURN - 10)
        self._write(draw, (_RETURN, middle), total, size)
        if moment.ended:
            self._write(draw, (_ACTION, middle), moment.ended, 20)
        elif isinstance(moment.answer, int):
            self._draw_action(draw, moment.answer, middle)
        else:
            self._draw_entries(draw, moment.answer, middle)

    def _draw_action(self, draw: ImageDraw, action: int, middle: float) -> None:
        room = _FIGURES.right - _ACTION - 20
        size = self._letters.fitting(self._names.actions[action], _SIZES, room)
        name = self._letters.cut(self._names.actions[action], size, room)
        fill = colour_of(action)
        box = (_ACTION, middle - 18, _ACTION + self._letters.width(name, size) + 20, middle + 19)
        draw.rounded_rectangle(box, 6, fill=fill)
        self._write(draw, (_ACTION + 10, middle), name, size, ink_on(fill))

    def _draw_entries(self, draw: ImageDraw, entries: tuple[float, ...], middle: float) -> None:
        """Draw the entries of a continuous action, in two lines where one is too short."""
        room = _FIGURES.right - _ACTION
        told = [f"{name} {short(entry)}" for name, entry in zip(self._names.actions, entries, strict=True)]
        size = self._letters.fitting(", ".join(told), _SIZES, room)
        if self._letters.width(", ".join(told), size) <= room:
            self._write(draw, (_ACTION, middle), ", ".join(told), size)
            return
        half = (len(told) + 1) // 2
        for line, y in ((told[:half], middle - 9), (told[half:], middle + 9)):
            self._write(draw, (_ACTION, y), self._letters.cut(", ".join(line), size, room), size)

    def _draw_values(self, draw: ImageDraw, moment: Moment) -> None:
        """Draw what is observed in two columns, what the rule looks at in black and first where not all fit."""
        n_rows = _VALUES.height // _ROW
        room = 2 * n_rows
        n_more = len(self._features) - room + 1 if len(self._features) > room else 0
        shown = self._features[: room - 1] if n_more else sorted(self._features)
        for i, feature in enumerate(shown):
            left, y = _cell(i, n_rows)
            ink, unit = INK if feature in self._used else QUIET, self._names.units[feature]
            name = self._letters.cut(self._names.features[feature], 16, _VALUES.width // 2 - 150)
            self._write(draw, (left, y), name, 16, ink)
            self._write(draw, (left + 194, y), short(float(moment.observation[feature])), 16, ink, "rm")
            self._write(draw, (left + 200, y), self._letters.cut(unit, 16, 60), 16, QUIET)
        if n_more:
            self._write(draw, _cell(room - 1, n_rows), f"and {n_more} more", 16, QUIET)


def features_in_order(controller: Controller) -> list[int]:
    """Return the numbers of all features, those that the rule looks at first."""
    used = _used(controller)
    return [*used, *(i for i in range(len(controller.names.features)) if i not in used)]


def _used(controller: Controller) -> list[int]:
    tree = controller.tree
    return list(dict.fromkeys([*tree.feature.tolist(), *tree.leaf_feature.tolist()]))


def _cell(i: int, n_rows: int) -> tuple[float, float]:
    """Return where the left end and the middle of a cell are."""
    column, row = divmod(i, n_rows)
    return _VALUES.left + column * (_VALUES.width // 2), _VALUES.top + row * _ROW + _ROW / 2


def _paste(image: Image, picture: Image) -> tuple[int, int, int, int]:
    """Put a picture into its place, as large as it can be, and return where its border is."""
    from PIL.Image import Resampling

    factor = min(_SCENE.width / picture.width, _SCENE.height / picture.height)
    size = (max(1, round(picture.width * factor)), max(1, round(picture.height * factor)))
    left, top = _SCENE.left + (_SCENE.width - size[0]) // 2, _SCENE.top + 1
    image.paste(picture.convert("RGB").resize(size, Resampling.LANCZOS), (left, top))
    return left - 1, top - 1, left + size[0], top + size[1]
