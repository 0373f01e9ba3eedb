"""Halls of fame of many runs: what the best trees of each size earn, as a table and as a figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ge_torchrl.report.canvas import GREY, new_figure
from ge_torchrl.report.figures import RUN_COLOURS
from ge_torchrl.report.runs import Run
from ge_torchrl.report.tables import markdown

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class SizeRow:
    """The best trees of one size in many runs.

    Attributes:
        decision_nodes: The size.
        test_means: The test mean of each run that has a tree of this size, in the order of the runs.
        champions: How many of these trees are their run's champion.
        chosen: The test mean of the tree that did best in validation: the one to take.
    """

    decision_nodes: int
    test_means: tuple[float, ...]
    champions: int
    chosen: float


def by_size(runs: Sequence[Run]) -> list[SizeRow]:
    """Return a row for each size that some run has a tree of, from small to large.

    Args:
        runs: Runs of one environment and method; those without a hall of fame add nothing.
    """
    sizes = sorted({record.decision_nodes for run in runs for record in run.hall_of_fame})
    rows = []
    for size in sizes:
        found = [
            (run, record) for run in runs for record in run.hall_of_fame if record.decision_nodes == size
        ]
        # The test is left out of the choice, so that what it says of the chosen tree stays honest.
        _, best = max(found, key=lambda pair: pair[1].validation_mean)
        rows.append(
            SizeRow(
                size,
                tuple(record.test_mean for _, record in found),
                sum(run.summary.decision_nodes == size for run, _ in found),
                best.test_mean,
            )
        )
    return rows


def hall_of_fame_table(runs: Sequence[Run]) -> str:
    """Return a Markdown table, a row a size: in how many runs, what their trees earn, and what the best one does.

    Args:
        runs: Runs of one environment and method, at least one of them with a hall of fame.
    """
    head = ["decision nodes", "runs", "mean test return", "median", "best in validation", "champions"]
    rows = [
        [
            str(row.decision_nodes),
            str(len(row.test_means)),
            f"{np.mean(row.test_means):.2f}",
            f"{np.median(row.test_means):.2f}",
            f"{row.chosen:.2f}",
            str(row.champions),
        ]
        for row in by_size(runs)
    ]
    return markdown(head, rows)


def size_figure(methods: Mapping[str, Sequence[Run]], *, title: str, solved_at: float | None) -> Figure:
    """Draw the test mean of the best trees against their size: a dot a run, a line through the medians.

    A lone leaf is left out where there are trees: it returns so little that they would all look the same.

    Args:
        methods: For each method, in the order of drawing, its runs.
        title: Stands above the figure.
        solved_at: Threshold to mark, or None.

    Raises:
        UserError: matplotlib is not installed.
    """
    figure = new_figure(6.4, 4.0)
    figure.set_layout_engine("constrained")
    axes = figure.add_subplot()
    if solved_at is not None:
        axes.axhline(solved_at, color=GREY, linestyle="--", linewidth=1, label=f"solved from {solved_at:g}")
    rows_of = {method: by_size(runs) for method, runs in methods.items()}
    sizes = {row.decision_nodes for rows in rows_of.values() for row in rows}
    sizes = sizes - {0} or sizes
    for i, (method, all_rows) in enumerate(rows_of.items()):
        colour = RUN_COLOURS[i % len(RUN_COLOURS)]
        rows = [row for row in all_rows if row.decision_nodes in sizes]
        for row in rows:
            at = [row.decision_nodes] * len(row.test_means)
            axes.plot(at, row.test_means, color=colour, marker="o", markersize=3, alpha=0.5, linestyle="none")
        medians = [float(np.median(row.test_means)) for row in rows]
        axes.plot([row.decision_nodes for row in rows], medians, color=colour, label=f"{method}, median")
    axes.set_title(title, loc="left")
    axes.set(xlabel="decision nodes", ylabel="test mean")
    axes.set_xticks(sorted(sizes))
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, loc="best")
    return figure
