"""A picture as SVG, whose texts are texts: they can be searched, copied and read aloud."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree as ET
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.exports import drawn
from ge_torchrl.exports.code import summary
from ge_torchrl.exports.colours import fill_and_ink
from ge_torchrl.exports.drawn import NO, YES, Drawing, DrawnNode, drawing_of
from ge_torchrl.exports.names import printably_named
from ge_torchrl.exports.written import Written
from ge_torchrl.report.drawing import BOX_HEIGHT, LINE_HEIGHT, Layout, tidy_layout
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.text import clipping_text
from ge_torchrl.trees.tree import FloatArray

# All lengths are pixels, of which an inch has 96.
_INCH, _FONT, _SMALL_FONT = 96, 13, 11
# Wider than most letters of most fonts, since nobody knows which font a reader has.
_LETTER, _WIDE_LETTER, _PADDING = 6.9, 14.0, 14.0
_BELOW = 24
_TAG = "{http://www.w3.org/2000/svg}"


def write(controller: Controller, name: str) -> bytes:  # noqa: ARG001 - a picture has no name.
    """Return the picture.

    Args:
        controller: The controller.
        name: Not used.
    """
    drawing, tree = drawing_of(controller), controller.tree
    # A layout takes the splits first, then the leaves.
    keys = sorted(drawing.nodes, key=lambda key: (not drawing.nodes[key].yes, int(key[1:])))
    widths = [2 * _PADDING + max(map(_width, drawing.nodes[key].lines)) for key in keys]
    n_lines = max(len(node.lines) for node in drawing.nodes.values())
    layout = tidy_layout(tree, np.array(widths) / _INCH, BOX_HEIGHT + LINE_HEIGHT * (n_lines - 1))
    boxes = _boxes(layout, keys)
    told = clipping_text(tree, printably_named(controller).names)
    width = max(layout.size[0] * _INCH, 2 * _PADDING + _width(told))
    height = layout.size[1] * _INCH + (_BELOW if told else 0)
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.1f} {height:.1f}" role="img" '
        f'font-family="Helvetica, Arial, sans-serif" font-size="{_FONT}" text-anchor="middle">'
    )
    title = f"<title>{escape(summary(controller))}</title>"
    lines = [head, title, '<rect width="100%" height="100%" fill="white"/>']
    for key, node in drawing.nodes.items():
        if node.yes:
            lines += _way(boxes[key], boxes[node.yes], YES) + _way(boxes[key], boxes[node.no], NO)
    for key, node in drawing.nodes.items():
        fill, ink = ("white", "black") if node.yes else fill_and_ink(tree, key)
        lines += _node(key, node, boxes[key], fill, ink)
    if told:
        lines.append(f'<text x="{width / 2:.1f}" y="{height - _BELOW / 2:.1f}">{escape(told)}</text>')
    return "\n".join([*lines, "</svg>", ""]).encode()


def answers(written: Sequence[Written], observed: Sequence[FloatArray]) -> list[NDArray[Any]]:
    """Return what the pictures answer to [B, D] observations of each."""
    return drawn.answers(_read, written, observed)


def _read(text: str) -> Drawing:
    # It is our own text.
    groups = ET.fromstring(text).findall(f"{_TAG}g")  # noqa: S314
    nodes = {
        group.attrib["id"]: DrawnNode(
            tuple(line.text or "" for line in group.iter(f"{_TAG}text")),
            group.get("data-yes", ""),
            group.get("data-no", ""),
        )
        for group in groups
    }
    (root,) = nodes.keys() - {way for node in nodes.values() for way in (node.yes, node.no)}
    return Drawing(nodes, root)


class _Box:
    """A box: the middle of its upper edge, and its size."""

    def __init__(self, x: float, top: float, width: float, height: float) -> None:
        self.x, self.top, self.width, self.height = x, top, width, height


def _boxes(layout: Layout, keys: Sequence[str]) -> dict[str, _Box]:
    x, width, height = layout.x * _INCH, layout.widths * _INCH, layout.heights * _INCH
    # A layout counts from below.
    top = (layout.size[1] - layout.y) * _INCH - height / 2
    return {key: _Box(*each) for key, *each in zip(keys, x, top, width, height, strict=True)}


def _width(line: str) -> float:
    return sum(_WIDE_LETTER if unicodedata.east_asian_width(each) in "WF" else _LETTER for each in line)


def _way(start: _Box, end: _Box, answer: str) -> list[str]:
    x1, y1, x2, y2 = start.x, start.top + start.height, end.x, end.top
    x, y = (x1 + x2) / 2, (y1 + y2) / 2
    return [
        f'<path d="M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}" stroke="#666666"/>',
        f'<rect x="{x - 12:.1f}" y="{y - 8:.1f}" width="24" height="16" fill="white"/>',
        f'<text x="{x:.1f}" y="{y + 4:.1f}" font-size="{_SMALL_FONT}" fill="#333333">{answer}</text>',
    ]


def _node(key: str, node: DrawnNode, box: _Box, fill: str, ink: str) -> list[str]:
    ways = f' data-yes="{node.yes}" data-no="{node.no}"' if node.yes else ""
    line_height = LINE_HEIGHT * _INCH
    first = box.top + box.height / 2 - line_height * (len(node.lines) - 1) / 2 + _FONT * 0.35
    rounding = 12 if node.yes else 2
    corner = f'x="{box.x - box.width / 2:.1f}" y="{box.top:.1f}"'
    size = f'width="{box.width:.1f}" height="{box.height:.1f}" rx="{rounding}"'
    texts = [
        f'<text x="{box.x:.1f}" y="{first + line_height * place:.1f}" fill="{ink}">{escape(line)}</text>'
        for place, line in enumerate(node.lines)
    ]
    return [
        f"<g id={quoteattr(key)}{ways}>",
        f'<rect {corner} {size} fill="{fill}" stroke="#333333"/>',
        *texts,
        "</g>",
    ]
