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
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.labels import TreeLabels
from ge_torchrl.trees.rendering import check_labels, shortest_decimal

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Neighbours in this order differ in lightness too.
ACTION_COLOURS = (SKY, ORANGE, GREEN, YELLOW, PURPLE, BLUE, VERMILION)
_DARK = {BLUE, GREEN, VERMILION}

# All lengths are inches, as the axes are scaled to the figure.
_FONT, _EDGE_FONT = 10.0, 8.0
_BOX_HEIGHT, _PADDING, _GAP, _MARGIN = 0.36, 0.16, 0.14, 0.2
_LEVEL = 0.95
# Two edges from one node leave room for a label each.
_LEAST_LEAF_DISTANCE = 0.95
# How far down an edge its label stands: far enough for two edges of a node to have parted.
_LABEL_AT = 0.55


class Layout(NamedTuple):
    """Where nodes stand, in inches from the lower left corner of the figure.

    Attributes:
        x: [N] centres.
        y: [N] centres.
        widths: [N] widths of the boxes.
        size: Width and height of the figure.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    widths: NDArray[np.float64]
    size: tuple[float, float]


def draw_tree(tree: DecisionTree, labels: TreeLabels) -> Figure:
    """Draw a tree: decisions as rounded boxes, leaves in the colour of their action, True to the left.

    Args:
        tree: The tree.
        labels: Names of its features and actions.

    Returns:
        A figure as large as the tree needs.

    Raises:
        InvalidTreeError: The tree uses a feature or an action that the labels do not have.
        UserError: matplotlib is not installed.
    """
    check_labels(tree, labels)
    texts = [_text(tree, labels, node) for node in range(tree.n_nodes)]
    figure = new_figure(1, 1)
    layout = tidy_layout(tree, np.array([_width(text) + 2 * _PADDING for text in texts]))
    figure.set_size_inches(layout.size)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, layout.size[0]), ylim=(0, layout.size[1]))
    axes.set_axis_off()
    for node, text in enumerate(texts):
        if not tree.is_leaf[node]:
            _draw_edge(axes, layout, node, int(tree.children_left[node]), "True")
            _draw_edge(axes, layout, node, int(tree.children_right[node]), "False")
        _draw_box(axes, layout, node, text, action=int(tree.action[node]))
    return figure


def save_tree(tree: DecisionTree, labels: TreeLabels, path: Path) -> tuple[Path, Path]:
    """Draw a tree and write it as SVG and PNG.

    Args:
        tree: The tree.
        labels: Names of its features and actions.
        path: Path of the files without suffix.

    Returns:
        Paths of the SVG and of the PNG.

    Raises:
        ArtefactError: The files cannot be written.
        InvalidTreeError: The tree uses a feature or an action that the labels do not have.
        UserError: matplotlib is not installed.
    """
    return save_figure(draw_tree(tree, labels), path)


def tidy_layout(tree: DecisionTree, widths: NDArray[np.float64]) -> Layout:
    """Place leaves side by side in their order, and each decision above the middle of its children.

    Two decisions of one depth are then at least two leaf distances apart, a decision and a leaf one and a
    half, so that the widths give the least distance at which no boxes meet.

    Args:
        tree: The tree.
        widths: [N] widths of the boxes.
    """
    place, depth = _places(tree)
    leaf, decision = widths[tree.is_leaf].max(), widths[~tree.is_leaf].max(initial=0.0)
    distance = max(
        _LEAST_LEAF_DISTANCE, leaf + _GAP, (decision + _GAP) / 2, ((leaf + decision) / 2 + _GAP) / 1.5
    )
    x = place * distance
    # A box may be wider than the leaves below it.
    x += _MARGIN - (x - widths / 2).min()
    height = 2 * _MARGIN + _BOX_HEIGHT + _LEVEL * depth.max()
    y = height - _MARGIN - _BOX_HEIGHT / 2 - _LEVEL * depth
    return Layout(x, y, widths, (float((x + widths / 2).max()) + _MARGIN, float(height)))


def _places(tree: DecisionTree) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return [N] the place of every node in units of a leaf's distance, and [N] its depth."""
    place, depth = np.zeros(tree.n_nodes), np.zeros(tree.n_nodes, np.int64)
    n_leaves, order, open_nodes = 0, [], [0]
    while open_nodes:
        node = open_nodes.pop()
        if tree.is_leaf[node]:
            place[node], n_leaves = n_leaves, n_leaves + 1
            continue
        order.append(node)
        children = [int(tree.children_right[node]), int(tree.children_left[node])]
        depth[children] = depth[node] + 1
        open_nodes += children
    for node in reversed(order):
        place[node] = (place[tree.children_left[node]] + place[tree.children_right[node]]) / 2
    return place, depth


def _text(tree: DecisionTree, labels: TreeLabels, node: int) -> str:
    if tree.is_leaf[node]:
        return labels.actions[int(tree.action[node])]
    feature = int(tree.feature[node])
    threshold = repr(shortest_decimal(tree.threshold[node])).removesuffix(".0")
    return f"{labels.features[feature]} < {threshold} {labels.units[feature]}".rstrip()


def _width(text: str) -> float:
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextToPath

    points: float = TextToPath().get_text_width_height_descent(text, FontProperties(size=_FONT), False)[0]
    return points / 72


def _draw_box(axes: Axes, layout: Layout, node: int, text: str, action: int) -> None:
    from matplotlib.patches import FancyBboxPatch

    is_leaf = action != DecisionTree.NO_ACTION
    colour = ACTION_COLOURS[action % len(ACTION_COLOURS)] if is_leaf else "white"
    rounding = 0.02 if is_leaf else 0.12
    x, y, width = layout.x[node], layout.y[node], layout.widths[node]
    axes.add_patch(
        FancyBboxPatch(
            (x - width / 2, y - _BOX_HEIGHT / 2),
            width,
            _BOX_HEIGHT,
            boxstyle=f"round,pad=0,rounding_size={rounding}",
            facecolor=colour,
            edgecolor="#333333",
            linewidth=1.0,
            zorder=3,
        )
    )
    ink = "white" if colour in _DARK else "black"
    # Names are no formulas, so a dollar in them is a dollar.
    axes.text(
        x, y, text, size=_FONT, color=ink, ha="center", va="center_baseline", zorder=4, parse_math=False
    )


def _draw_edge(axes: Axes, layout: Layout, node: int, child: int, answer: str) -> None:
    x = np.array([layout.x[node], layout.x[child]])
    y = np.array([layout.y[node] - _BOX_HEIGHT / 2, layout.y[child] + _BOX_HEIGHT / 2])
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
