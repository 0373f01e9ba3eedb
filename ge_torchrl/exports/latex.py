"""A drawing for LaTeX, by its package forest."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

from ge_torchrl.exports import drawn
from ge_torchrl.exports.code import summary
from ge_torchrl.exports.drawn import NO, YES, Drawing, DrawnNode, Nodes, drawing_of, led_to
from ge_torchrl.exports.names import printably_named
from ge_torchrl.exports.written import Written
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.text import clipping_text
from ge_torchrl.trees.tree import FloatArray

_LETTERS = "αβγδεζηθικλμνξπρστυφχψωΓΔΘΛΞΠΣΦΨΩ"
_LETTER_NAMES = (
    "alpha beta gamma delta varepsilon zeta eta theta iota kappa lambda mu nu xi pi rho sigma tau upsilon varphi chi "
    "psi omega Gamma Delta Theta Lambda Xi Pi Sigma Phi Psi Omega"
)
_GREEK = dict(zip(_LETTERS, _LETTER_NAMES.split(" "), strict=True))
_COMMANDS = {
    **{character: f"\\{character}" for character in "{}$&#%_"},
    "\\": "\\textbackslash{}",
    "^": "\\textasciicircum{}",
    "~": "\\textasciitilde{}",
    **{character: f"${character}$" for character in "<>|-"},
    **{character: f"$\\{name}$" for character, name in _GREEK.items()},
}
_CHARACTERS = {command: character for character, command in _COMMANDS.items()}
# The longest commands first.
_COMMAND = re.compile("|".join(map(re.escape, sorted(_CHARACTERS, key=len, reverse=True))))
_BREAK = "\\\\"
_LINE = re.compile(r"^ *\[\{(?P<label>.*)\}(?:, split)?(?:, (?P<answer>yes|no))?(?P<closes>\]?)$")
_HEAD = """\
% {summary}
% In the preamble: \\usepackage{{forest}}
\\begin{{forest}}
  split/.style={{rounded corners}},
  yes/.style={{edge label={{node[midway, left, font=\\scriptsize]{{yes}}}}}},
  no/.style={{edge label={{node[midway, right, font=\\scriptsize]{{no}}}}}},
  for tree={{draw, align=center, s sep=5mm, l sep=8mm}}
"""


def write(controller: Controller, name: str) -> bytes:  # noqa: ARG001 - a picture has no name.
    """Return the picture.

    Args:
        controller: The controller.
        name: Not used.
    """
    drawing = drawing_of(controller)
    lines = [_HEAD.format(summary=summary(controller)).rstrip("\n")]
    # A node, how deep it stands, and the answer that leads to it; or what closes one.
    open_nodes = [(drawing.root, 1, "")]
    while open_nodes:
        key, depth, answer = open_nodes.pop()
        if not key:
            lines.append("  " * depth + "]")
            continue
        node = drawing.nodes[key]
        label = _BREAK.join(map(_escaped, node.lines))
        parts = [f"[{{{label}}}", *(["split"] if node.yes else []), *([answer] if answer else [])]
        lines.append("  " * depth + ", ".join(parts) + ("" if node.yes else "]"))
        if node.yes:
            open_nodes += [("", depth, ""), (node.no, depth + 1, NO), (node.yes, depth + 1, YES)]
    lines.append("\\end{forest}")
    if told := clipping_text(controller.tree, printably_named(controller).names):
        lines.append(f"% {told}")
    return "\n".join([*lines, ""]).encode()


def answers(written: Sequence[Written], observed: Sequence[FloatArray]) -> list[NDArray[Any]]:
    """Return what the pictures answer to [B, D] observations of each."""
    return drawn.answers(_read, written, observed)


def _read(text: str) -> Drawing:
    nodes: Nodes = {}
    above: list[str] = []
    for line in text.split("\n"):
        if line.strip() == "]":
            above.pop()
        elif found := _LINE.match(line):
            key = f"n{len(nodes)}"
            nodes[key] = DrawnNode(tuple(map(_plain, found["label"].split(_BREAK))))
            if found["answer"]:
                led_to(nodes, above[-1], found["answer"], key)
            if not found["closes"]:
                above.append(key)
    return Drawing(nodes, "n0")


def _escaped(text: str) -> str:
    return "".join(_COMMANDS.get(character, character) for character in text)


def _plain(label: str) -> str:
    return _COMMAND.sub(lambda found: _CHARACTERS[found[0]], label)
