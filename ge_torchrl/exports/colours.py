"""Colours of leaves."""

from __future__ import annotations

from ge_torchrl.report.drawing import ACTION_COLOURS, DARK_COLOURS
from ge_torchrl.trees.tree import DecisionTree


def fill_and_ink(tree: DecisionTree, key: str) -> tuple[str, str]:
    """Return the colour of a leaf `l0`, `l1`, ..., that of its action, and the colour of the text on it."""
    if not tree.has_actions:
        return "white", "black"
    fill = ACTION_COLOURS[int(tree.action[int(key[1:])]) % len(ACTION_COLOURS)]
    return fill, "white" if fill in DARK_COLOURS else "black"
