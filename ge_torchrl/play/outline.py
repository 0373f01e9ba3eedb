"""A tree as an outline: a row for each split and leaf, indented by depth, folded where there is no room for all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ge_torchrl.report.tables import counted
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.text import leaf_lines, split_text


@dataclass(frozen=True)
class Row:
    """A split or a leaf.

    Attributes:
        node: The number of a split, or `~leaf`.
        parent: The place of the row of its parent; -1 of the root.
        depth: Splits above it.
        branch: "yes" or "no"; empty at the root.
        texts: What the split asks, or what the leaf answers, one text for each value.
    """

    node: int
    parent: int
    depth: int
    branch: str
    texts: tuple[str, ...]


def outline(controller: Controller) -> tuple[Row, ...]:
    """Return the rows of a tree, depth first, yes before no."""
    tree, names = controller.tree, controller.names
    if tree.num_decision_nodes == 0:
        first, *others = leaf_lines(tree, names, 0)
        return (Row(~0, -1, 0, "", (f"always {first}", *others)),)
    rows: list[Row] = []
    open_nodes = [(0, -1, 0, "")]
    while open_nodes:
        node, parent, depth, branch = open_nodes.pop()
        texts = leaf_lines(tree, names, ~node) if node < 0 else [f"{split_text(tree, names, node)}?"]
        rows.append(Row(node, parent, depth, branch, tuple(texts)))
        if node >= 0:
            place = len(rows) - 1
            open_nodes.append((int(tree.children_right[node]), place, depth + 1, "no"))
            open_nodes.append((int(tree.children_left[node]), place, depth + 1, "yes"))
    return tuple(rows)


class Folding:
    """Chooses what is shown of an outline where there is no room for all of it.

    Args:
        rows: Of the outline.
        heights: Of each row.
        folded_height: Of a row that stands for its whole subtree.
    """

    def __init__(self, rows: Sequence[Row], heights: Sequence[float], folded_height: float) -> None:
        self._rows, self._heights, self._folded_height = rows, heights, folded_height
        self._children: dict[int, list[int]] = {}
        for place, row in enumerate(rows):
            self._children.setdefault(row.parent, []).append(place)
        self._n_splits = [int(row.node >= 0) for row in rows]
        for place in reversed(range(1, len(rows))):
            self._n_splits[rows[place].parent] += self._n_splits[place]

    def text(self, place: int) -> str:
        """Return what a row says that stands for its whole subtree."""
        return f"... {counted(self._n_splits[place], 'split')}"

    def shown(self, path: Sequence[int], room: float) -> dict[int, bool]:
        """Return the places of the rows that are shown, in their order, and whether each is folded.

        The path and what branches off it comes first, then what is nearest to the root. Where even the path is too
        long, its first rows are left out.

        Args:
            path: Places of the rows on the path, from the root on.
            room: Height of all that is shown.
        """
        shown = dict.fromkeys([0], self._rows[0].node >= 0)
        for place in path:
            self._open(place, shown)
        used = sum(self.height(place, is_folded=folded) for place, folded in shown.items())
        # Breadth first, and as far as the room goes.
        waiting = sorted(shown, key=lambda place: self._rows[place].depth)
        for place in waiting:
            more = self._more(place) if shown[place] else 0.0
            if shown[place] and used + more <= room:
                used += more
                waiting += self._open(place, shown)
        places = sorted(shown)
        while used > room and len(places) > 1:
            # What stands above the end of the path goes first, then what stands below it.
            place = places.pop(0) if places[0] < path[-1] else places.pop()
            used -= self.height(place, is_folded=shown[place])
        return {place: shown[place] for place in places}

    def height(self, place: int, *, is_folded: bool) -> float:
        """Return the height of a row."""
        return self._folded_height if is_folded else self._heights[place]

    def _open(self, place: int, shown: dict[int, bool]) -> list[int]:
        """Show the children of a row; return their places."""
        children = self._children.get(place, [])
        shown[place] = False
        shown.update({child: self._rows[child].node >= 0 for child in children})
        return children

    def _more(self, place: int) -> float:
        """Return the height that showing the children of a row adds."""
        below = (self.height(child, is_folded=self._rows[child].node >= 0) for child in self._children[place])
        return self._heights[place] - self._folded_height + sum(below)
