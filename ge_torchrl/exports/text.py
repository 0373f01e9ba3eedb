"""A tree drawn with lines, as a run prints it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

from ge_torchrl.exports import drawn
from ge_torchrl.exports.drawn import NO, YES, Drawing, DrawnNode, Nodes, led_to
from ge_torchrl.exports.names import printably_named
from ge_torchrl.exports.written import Written
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.text import clipping_text, render_text
from ge_torchrl.trees.tree import FloatArray

_FRONT = re.compile(r"(?:│ {7}| {8})*(├─ yes: |└─ no:  )")
_WAY = {"├": YES, "└": NO}
# Letters that a line is indented by on each level.
_STEP = 8


def write(controller: Controller, name: str) -> bytes:  # noqa: ARG001 - a drawing has no name.
    """Return the drawing.

    Args:
        controller: The controller.
        name: Not used.
    """
    shown = printably_named(controller)
    told = clipping_text(shown.tree, shown.names)
    return "\n".join([render_text(shown.tree, shown.names), *([told] if told else []), ""]).encode()


def answers(written: Sequence[Written], observed: Sequence[FloatArray]) -> list[NDArray[Any]]:
    """Return what the drawings answer to [B, D] observations of each."""
    return drawn.answers(_read, written, observed)


def _read(text: str) -> Drawing:
    found = [("", 0, text.split("\n", maxsplit=1)[0])]
    for line in text.split("\n")[1:]:
        front = _FRONT.match(line)
        if front is None:
            break
        found.append((_WAY[front[1][0]], front.end() // _STEP, line[front.end() :]))
    nodes: Nodes = {}
    above: list[str] = []
    for place, (answer, depth, told) in enumerate(found):
        key, below = f"n{place}", found[place + 1 : place + 2]
        is_split = bool(below) and below[0][1] > depth
        label = told.removesuffix("?") if is_split else told
        nodes[key] = DrawnNode((label if answer or is_split else label.removeprefix("always "),))
        del above[depth:]
        if answer:
            led_to(nodes, above[-1], answer, key)
        above.append(key)
    return Drawing(nodes, "n0")
