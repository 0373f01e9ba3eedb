"""A tree as a picture, in the manner of the thesis' figures 4.3, 4.5 and 4.7."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.report.canvas import (
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    YELLOW,
    new_figure,
    save_figure,
)
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.text import leaf_lines, split_text
from ge_torchrl.trees.tree import DecisionTree

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Neighbours in this order differ in lightness too.
ACTION_COLOURS = (SKY, ORANGE, GREEN, YELLOW, PURPLE, BLUE, VERMILION)
DARK_COLOURS = {BLUE, GREEN, VERMILION}

# All lengths are inches, as the axes are scaled to the figure.
_FONT, _EDGE_FONT = 10.0, 8.0
BOX_HEIGHT, _PADDING, _GAP, _MARGIN = 0.36, 0.16, 0.14, 0.2
_LEVEL = 0.95
LINE_HEIGHT = 0.19
# Two edges from one node leave room for a label each.
_LEAST_LEAF_DISTANCE = 0.95
# How far down an edge its label stands: far enough for two edges of a node to have parted.
_LABEL_AT = 0.55


class Layout(NamedTuple):
    """Where nodes stand, in inches from the lower left corner of the figure: the splits, and after them the leaves.

    Attributes:
        x: [N] centres, `N = M + L`.
        y: [N] centres.
        widths: [N] widths of the boxes.
        heights: [N] their heights.
        size: Width and height of the figure.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    widths: NDArray[np.float64]
    heights: NDArray[np.float64]
    size: tuple[float, float]


def draw_tree(controller: Controller) -> Figure:
    """Draw a tree: decisions as rounded boxes, leaves in the colour of their action, True to the left.

    Args:
        controller: The tree, with the names of its features and actions.

    Returns:
        A figure as large as the tree needs.

    Raises:
        UserError: matplotlib is not installed.
    """
    tree, names = controller.tree, controller.names
    n_splits = tree.num_decision_nodes
    texts = [split_text(tree, names, split) for split in range(n_splits)]
    # A leaf with several values has a line for each.
    texts += ["\n".join(leaf_lines(tree, names, leaf)) for leaf in range(tree.num_leaves)]
    leaf_height = BOX_HEIGHT + LINE_HEIGHT * texts[-1].count("\n")
    figure = new_figure(1, 1)
    layout = tidy_layout(tree, np.array([_width(text) + 2 * _PADDING for text in texts]), leaf_height)
    figure.set_size_inches(layout.size)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, layout.size[0]), ylim=(0, layout.size[1]))
    axes.set_axis_off()
    left, right = _children(tree)
    for node, text in enumerate(texts):
        if node < n_splits:
            _draw_edge(axes, layout, node, left[node], "True")
            _draw_edge(axes, layout, node, right[node], "False")
            _draw_box(axes, layout, node, text, "white", rounding=0.12)
        else:
            _draw_box(axes, layout, node, text, _leaf_colour(tree, node - n_splits), rounding=0.02)
    return figure


def save_tree(controller: Controller, path: Path) -> tuple[Path, Path]:
    """Draw a tree and write it as SVG and PNG.

    Args:
        controller: The tree, with the names of its features and actions.
        path: Path of the files without suffix.

    Returns:
        Paths of the SVG and of the PNG.

    Raises:
        ArtefactError: The files cannot be written.
        UserError: matplotlib is not installed.
    """
    return save_figure(draw_tree(controller), path)


def tidy_layout(tree: DecisionTree, widths: NDArray[np.float64], leaf_height: float = BOX_HEIGHT) -> Layout:
    """Place leaves side by side in their order, and each decision above the middle of its children.

    Two decisions of one depth are then at least two leaf distances apart, a decision and a leaf one and a
    half, so that the widths give the least distance at which no boxes meet.

    Args:
        tree: The tree.
        widths: [N] widths of the boxes, the splits' first.
        leaf_height: Height of a leaf's box.
    """
    place, depth = _places(tree)
    n_splits = tree.num_decision_nodes
    leaf, decision = widths[n_splits:].max(), widths[:n_splits].max(initial=0.0)
    distance = max(
        _LEAST_LEAF_DISTANCE, leaf + _GAP, (decision + _GAP) / 2, ((leaf + decision) / 2 + _GAP) / 1.5
    )
    x = place * distance
    # A box may be wider than the leaves below it.
    x += _MARGIN - (x - widths / 2).min()
    heights = np.repeat([BOX_HEIGHT, leaf_height], [n_splits, tree.num_leaves])
    level = _LEVEL + (leaf_height - BOX_HEIGHT)
    # Boxes of one level stand level at their tops, and the lowest ones are leaves.
    height = 2 * _MARGIN + leaf_height + level * depth.max()
    y = height - _MARGIN - heights / 2 - level * depth
    return Layout(x, y, widths, heights, (float((x + widths / 2).max()) + _MARGIN, float(height)))


def _children(tree: DecisionTree) -> tuple[list[int], list[int]]:
    """Return [M] the left and the right child of every split, where leaf `l` is node `M + l`."""
    n_splits = tree.num_decision_nodes
    left, right = (
        np.where(children >= 0, children, n_splits + ~children).tolist()
        for children in (tree.children_left, tree.children_right)
    )
    return left, right


def _places(tree: DecisionTree) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return [N] the place of every node in units of a leaf's distance, and [N] its depth."""
    n_splits, left, right = tree.num_decision_nodes, *_children(tree)
    # Splits are numbered depth first, so that parents come before their children, and leaves from left to right.
    place = np.concatenate([np.zeros(n_splits), np.arange(float(tree.num_leaves))])
    depth = np.zeros(len(place), np.int64)
    for split in range(n_splits):
        depth[[left[split], right[split]]] = depth[split] + 1
    for split in reversed(range(n_splits)):
        place[split] = (place[left[split]] + place[right[split]]) / 2
    return place, depth


def _leaf_colour(tree: DecisionTree, leaf: int) -> str:
    """Return the colour of a leaf's action; white where leaves hold values."""
    return ACTION_COLOURS[int(tree.action[leaf]) % len(ACTION_COLOURS)] if tree.has_actions else "white"


def _width(text: str) -> float:
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextToPath

    font, path = FontProperties(size=_FONT), TextToPath()
    points: float = max(path.get_text_width_height_descent(line, font, False)[0] for line in text.split("\n"))
    return points / 72


def _draw_box(axes: Axes, layout: Layout, node: int, text: str, colour: str, *, rounding: float) -> None:
    from matplotlib.patches import FancyBboxPatch

    x, y, width, height = layout.x[node], layout.y[node], layout.widths[node], layout.heights[node]
    axes.add_patch(
        FancyBboxPatch(
            (x - width / 2, y - height / 2),
            width,
            height,
            boxstyle=f"round,pad=0,rounding_size={rounding}",
            facecolor=colour,
            edgecolor="#333333",
            linewidth=1.0,
            zorder=3,
        )
    )
    ink = "white" if colour in DARK_COLOURS else "black"
    # Names are no formulas, so a dollar in them is a dollar.
    axes.text(
        x, y, text, size=_FONT, color=ink, ha="center", va="center_baseline", zorder=4, parse_math=False
    )


def _draw_edge(axes: Axes, layout: Layout, node: int, child: int, answer: str) -> None:
    x = np.array([layout.x[node], layout.x[child]])
    y = np.array([layout.y[node] - layout.heights[node] / 2, layout.y[child] + layout.heights[child] / 2])
    axes.plot(x, y, color="#666666", linewidth=1.0, zorder=1)
    axes.text(
        x[0] + _LABEL_AT * (x[1] - x[0]),
        y[0] + _LABEL_AT * (y[1] - y[0]),
        answer,
        size=_EDGE_FONT,
        color="#333333",
        ha="center",
        va="center",
        bbox={"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none"},
        zorder=2,
    )
