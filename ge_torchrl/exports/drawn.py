"""What drawings share: nodes with labels, and an independent reading of them.

A drawing is verified in three steps. Its text is read back as nodes and ways. Each label has to be what the tree says
at that node. And the numbers of the labels are read, with plain names in place of the user's, since those may look like
numbers.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.exports.code import bounds_of
from ge_torchrl.exports.names import printably_named
from ge_torchrl.exports.written import Written
from ge_torchrl.trees.controller import Controller, Names
from ge_torchrl.trees.text import leaf_lines, split_text
from ge_torchrl.trees.tree import FloatArray

YES, NO = "yes", "no"

_NUMBER = r"\d+(?:\.\d+)?(?:e[+-]?\d+)?"
_TERM = re.compile(rf" ?(?P<sign>[-+]?) ?(?:(?P<number>{_NUMBER})(?: (?P<weighed>f\d+))?|(?P<name>f\d+))")


class DrawingError(Exception):
    """A drawing does not say what its tree says."""


class DrawnNode(NamedTuple):
    """A node of a drawing.

    Attributes:
        lines: Its label.
        yes: Where the answer yes leads; empty at a leaf.
        no: Where the answer no leads; empty at a leaf.
    """

    lines: tuple[str, ...]
    yes: str = ""
    no: str = ""


Nodes = dict[str, DrawnNode]


class Drawing(NamedTuple):
    """What is read back from a drawing: by their names, the nodes; and the name of the root."""

    nodes: Nodes
    root: str


def drawing_of(controller: Controller) -> Drawing:
    """Return a tree as nodes with labels, depth first: its splits `s0`, `s1`, ... and its leaves `l0`, `l1`, ..."""
    shown = printably_named(controller)
    tree = shown.tree

    def name(child: int) -> str:
        return f"s{child}" if child >= 0 else f"l{~child}"

    root = 0 if tree.num_decision_nodes else ~0
    nodes: Nodes = {}
    open_nodes = [root]
    while open_nodes:
        node = open_nodes.pop()
        if node < 0:
            nodes[name(node)] = DrawnNode(tuple(leaf_lines(tree, shown.names, ~node)))
            continue
        yes, no = int(tree.children_left[node]), int(tree.children_right[node])
        nodes[name(node)] = DrawnNode((split_text(tree, shown.names, node),), name(yes), name(no))
        open_nodes += (no, yes)
    return Drawing(nodes, name(root))


def answers(
    read: Callable[[str], Drawing], written: Sequence[Written], observed: Sequence[FloatArray]
) -> list[NDArray[Any]]:
    """Return what drawings answer to [B, D] observations of each.

    Args:
        read: Reads a drawing from its text.
        written: The drawings.
        observed: [B, D] float32 of each.

    Raises:
        DrawingError: One cannot be read, or says something else than the tree.
    """
    return [
        _answers(read(one.content.decode()), one.controller, rows)
        for one, rows in zip(written, observed, strict=True)
    ]


def _answers(drawing: Drawing, controller: Controller, rows: FloatArray) -> NDArray[Any]:
    shown, plain = (drawing_of(each) for each in (controller, _plainly_named(controller)))
    tree, names = controller.tree, controller.names
    n_values = 1 if tree.has_actions else len(names.actions)
    answer = np.zeros((len(rows), n_values))
    # A node of the drawing, the one of the tree that it has to be, and the rows that come there.
    open_nodes = [(drawing.root, shown.root, np.arange(len(rows)))]
    while open_nodes:
        drawn, meant, there = open_nodes.pop()
        if drawn not in drawing.nodes:
            raise DrawingError(f"{drawn or 'a node'} is missing")
        node = drawing.nodes[drawn]
        said, expected = (", ".join(each.lines) for each in (node, shown.nodes[meant]))
        if said != expected or bool(node.yes) != bool(shown.nodes[meant].yes):
            raise DrawingError(f"a node says {said!r}, and the tree {expected!r}")
        lines = plain.nodes[meant].lines
        if not node.yes:
            answer[there] = _leaf_answers(lines, rows[there], has_actions=tree.has_actions)
            continue
        text, threshold = lines[0].split(" < ")
        is_left = _summed(text, rows[there]) < np.float32(threshold)
        open_nodes.append((node.yes, shown.nodes[meant].yes, there[is_left]))
        open_nodes.append((node.no, shown.nodes[meant].no, there[~is_left]))
    if tree.has_actions:
        return answer[:, 0].astype(np.int32)
    with np.errstate(over="ignore"):
        return np.clip(answer.astype(np.float32), *bounds_of(names))


def _leaf_answers(lines: Sequence[str], rows: FloatArray, *, has_actions: bool) -> NDArray[np.float64]:
    if has_actions:
        return np.full((len(rows), 1), float(lines[0].removeprefix("a")))
    return np.stack([_summed(line.partition(" = ")[2], rows) for line in lines], axis=1)


def _summed(text: str, rows: FloatArray) -> NDArray[np.float64]:
    """Return what a sum such as `0.5 - 2 f1 + f0` is for each row."""
    total, place = np.zeros(len(rows)), 0
    while place < len(text):
        found = _TERM.match(text, place)
        if found is None:
            raise DrawingError(f"{text!r} is no sum")
        number = np.float64(np.float32(found["number"] or 1)) * (-1 if found["sign"] == "-" else 1)
        name = found["weighed"] or found["name"]
        with np.errstate(invalid="ignore"):
            total += number * rows[:, int(name[1:])].astype(np.float64) if name else number
        place = found.end()
    return total


def _plainly_named(controller: Controller) -> Controller:
    names: Names = controller.names
    features = tuple(f"f{place}" for place in range(len(names.features)))
    actions = tuple(f"a{place}" for place in range(len(names.actions)))
    units = ("",) * len(features)
    return replace(controller, names=replace(names, features=features, units=units, actions=actions))


def led_to(nodes: Nodes, above: str, answer: str, below: str) -> None:
    """Note in the nodes that are read so far that an answer to one of them leads to another."""
    node = nodes[above]
    nodes[above] = node._replace(yes=below) if answer == YES else node._replace(no=below)
