"""A drawing for Mermaid, which Markdown pages of GitHub and GitLab show."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

from ge_torchrl.exports import drawn
from ge_torchrl.exports.code import summary
from ge_torchrl.exports.colours import fill_and_ink
from ge_torchrl.exports.drawn import NO, YES, Drawing, DrawnNode, drawing_of
from ge_torchrl.exports.names import printably_named
from ge_torchrl.exports.written import Written
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.text import clipping_text
from ge_torchrl.trees.tree import FloatArray

# What Mermaid, Markdown and HTML all take for itself; anything else is written as its number.
_ITSELF = re.compile(r"[\w .,=+/()-]")
_BREAK = "<br>"
_NODE = re.compile(r'^    (\w+)[(\[]"(.*?)"[)\]]', re.MULTILINE)
_EDGE = re.compile(r"^    (\w+) -->\|(\w+)\| (\w+)$", re.MULTILINE)


def write(controller: Controller, name: str) -> bytes:  # noqa: ARG001 - a flow chart has no name.
    """Return the flow chart.

    Args:
        controller: The controller.
        name: Not used.
    """
    drawing = drawing_of(controller)
    lines = [f"%% {summary(controller).replace('{', '(').replace('}', ')')}", "flowchart TD"]
    if told := clipping_text(controller.tree, printably_named(controller).names):
        lines.append(f"%% {told}".replace("{", "(").replace("}", ")"))
    styles = []
    for key, node in drawing.nodes.items():
        label = _BREAK.join(map(_escaped, node.lines))
        lines.append(f'    {key}("{label}")' if node.yes else f'    {key}["{label}"]')
        if not node.yes and controller.tree.has_actions:
            fill, ink = fill_and_ink(controller.tree, key)
            styles.append(f"    style {key} fill:{fill},color:{ink}")
    for key, node in drawing.nodes.items():
        if node.yes:
            lines.append(f"    {key} -->|{YES}| {node.yes}")
            lines.append(f"    {key} -->|{NO}| {node.no}")
    return "\n".join([*lines, *styles, ""]).encode()


def answers(written: Sequence[Written], observed: Sequence[FloatArray]) -> list[NDArray[Any]]:
    """Return what the flow charts answer to [B, D] observations of each."""
    return drawn.answers(_read, written, observed)


def _read(text: str) -> Drawing:
    ways = {(start, answer): end for start, answer, end in _EDGE.findall(text)}
    nodes = {
        key: DrawnNode(
            tuple(map(_plain, label.split(_BREAK))), ways.get((key, YES), ""), ways.get((key, NO), "")
        )
        for key, label in _NODE.findall(text)
    }
    (root,) = nodes.keys() - set(ways.values())
    return Drawing(nodes, root)


def _escaped(text: str) -> str:
    return "".join(character if _ITSELF.fullmatch(character) else f"#{ord(character)};" for character in text)


def _plain(label: str) -> str:
    return re.sub(r"#(\d+);", lambda found: chr(int(found[1])), label)
