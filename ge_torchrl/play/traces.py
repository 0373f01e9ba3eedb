"""What is observed over time, in place of a picture where an environment draws none."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.play.episode import Moment
from ge_torchrl.play.ink import INK, LINE, LIT_LINE, QUIET
from ge_torchrl.play.lettering import Lettering, short
from ge_torchrl.play.rule import Box
from ge_torchrl.trees.controller import Names

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw

_MOST_STRIPS = 6
# Pixels.
_PADDING, _LABELS, _SIZE = 10, 150, 13
# Room for a name between two numbers.
_LEAST_WITH_RANGE = 56


class Traces:
    """A strip for each feature, over a whole episode, drawn as far as the episode has come.

    Args:
        names: Of the features.
        features: Numbers of the features, those that matter most first.
        observations: [T, D] of the episode.
    """

    def __init__(self, names: Names, features: Sequence[int], observations: NDArray[np.float32]) -> None:
        self._names, self._features = names, features[:_MOST_STRIPS]
        self._observations = observations

    def draw(self, draw: ImageDraw, box: Box, moment: Moment, letters: Lettering) -> None:
        """Draw all strips into a box."""
        height = box.height / len(self._features)
        for i, feature in enumerate(self._features):
            top = box.top + i * height
            if i:
                draw.line((box.left, top, box.right, top), fill=LINE)
            self._write(draw, box, top, top + height, feature, letters)
            self._draw_line(draw, box, top + _PADDING, top + height - _PADDING, feature, moment)

    def _write(
        self, draw: ImageDraw, box: Box, top: float, bottom: float, feature: int, letters: Lettering
    ) -> None:
        """Write the name of a feature and the range of its strip."""
        series, right = self._observations[:, feature], box.left + _LABELS
        name, unit = self._names.features[feature], self._names.units[feature]
        text = letters.cut(f"{name} [{unit}]" if unit else name, _SIZE, _LABELS - _PADDING)
        font = letters.font(_SIZE)
        draw.text((box.left, (top + bottom) / 2), text, fill=INK, font=font, anchor="lm")
        if bottom - top >= _LEAST_WITH_RANGE:
            for y, value, anchor in ((top + 6, series.max(), "rt"), (bottom - 6, series.min(), "rb")):
                draw.text((right, y), short(float(value)), fill=QUIET, font=font, anchor=anchor)

    def _draw_line(
        self, draw: ImageDraw, box: Box, top: float, bottom: float, feature: int, moment: Moment
    ) -> None:
        series = self._observations[:, feature].astype(np.float64)
        low, high = float(series.min()), float(series.max())
        left, right = box.left + _LABELS + _PADDING, box.right - _PADDING
        # What never changes lies in the middle.
        part = (series - low) / (high - low) if high > low else np.full(len(series), 0.5)
        x = left + (right - left) * np.arange(len(series)) / max(1, len(series) - 1)
        y = bottom - (bottom - top) * part
        points = list(zip(x.tolist(), y.tolist(), strict=True))
        now = min(moment.step, len(points) - 1)
        draw.line(points, fill=LINE, width=1)
        draw.line(points[: now + 1], fill=LIT_LINE, width=2)
        (x_now, y_now), radius = points[now], 4
        draw.ellipse((x_now - radius, y_now - radius, x_now + radius, y_now + radius), fill=LIT_LINE)
