"""Colours of leaves."""

from __future__ import annotations

from ge_torchrl.report.drawing import ACTION_COLOURS, DARK_COLOURS
from ge_torchrl.trees.tree import DecisionTree


def fill_and_ink(tree: DecisionTree, leaf: int) -> tuple[str, str]:
    """Return the colour of a leaf, that of its action, and the colour of the text on it."""
    if not tree.has_actions:
        return "white", "black"
    fill = ACTION_COLOURS[int(tree.action[leaf]) % len(ACTION_COLOURS)]
    return fill, "white" if fill in DARK_COLOURS else "black"
