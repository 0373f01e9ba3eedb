"""A drawing for Graphviz."""

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

# Longer texts first: what stands for a character holds others.
_ESCAPES = (("&", "&amp;"), ("\\", "\\\\"), ('"', '\\"'))
_NODE = re.compile(r'^  (\w+) \[label="((?:[^"\\]|\\.)*)"', re.MULTILINE)
_EDGE = re.compile(r'^  (\w+) -> (\w+) \[label="(\w+)"\]', re.MULTILINE)


def write(controller: Controller, name: str) -> bytes:
    """Return the graph.

    Args:
        controller: The controller.
        name: The name of the graph.
    """
    drawing = drawing_of(controller)
    lines = [
        f"// {summary(controller)}",
        f'digraph "{name}" {{',
        '  graph [ordering=out, fontname="Helvetica"];',
        '  node [shape=box, style="filled,rounded", fillcolor=white, fontname="Helvetica"];',
        '  edge [fontname="Helvetica", fontsize=10];',
    ]
    if told := clipping_text(controller.tree, printably_named(controller).names):
        lines.append(f'  label="{_escaped(told)}";')
    for key, node in drawing.nodes.items():
        label = "\\n".join(map(_escaped, node.lines))
        style = ""
        if not node.yes:
            fill, ink = fill_and_ink(controller.tree, key)
            style = f', style=filled, fillcolor="{fill}", fontcolor={ink}'
        lines.append(f'  {key} [label="{label}"{style}];')
    for key, node in drawing.nodes.items():
        if node.yes:
            lines.append(f'  {key} -> {node.yes} [label="{YES}"];')
            lines.append(f'  {key} -> {node.no} [label="{NO}"];')
    return "\n".join([*lines, "}", ""]).encode()


def answers(written: Sequence[Written], observed: Sequence[FloatArray]) -> list[NDArray[Any]]:
    """Return what the graphs answer to [B, D] observations of each."""
    return drawn.answers(_read, written, observed)


def _read(text: str) -> Drawing:
    ways = {(start, answer): end for start, end, answer in _EDGE.findall(text)}
    nodes = {
        key: DrawnNode(_lines(label), ways.get((key, YES), ""), ways.get((key, NO), ""))
        for key, label in _NODE.findall(text)
    }
    (root,) = nodes.keys() - set(ways.values())
    return Drawing(nodes, root)


def _escaped(text: str) -> str:
    for character, escape in _ESCAPES:
        text = text.replace(character, escape)
    return text


def _lines(label: str) -> tuple[str, ...]:
    # Read from left to right, as Graphviz does.
    pieces = re.findall(r"\\.|&amp;|[^\\]", label)
    plain = {"\\\\": "\\", '\\"': '"', "\\n": "\n", "&amp;": "&"}
    return tuple("".join(plain.get(piece, piece) for piece in pieces).split("\n"))
