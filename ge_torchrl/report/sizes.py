"""The best trees of each size, of one run or of many: one table, and one figure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ge_torchrl.artefacts.records import ArchiveRecord
from ge_torchrl.report.canvas import legend_beside, new_axes, run_colours
from ge_torchrl.report.tables import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class SizedTree:
    """The best tree of one size in one run, and what a test said of it.

    Attributes:
        seed: Of the run.
        decision_nodes: Of the tree.
        mean: Its mean test return.
        std: Standard deviation of its test returns.
        validation_mean: Its mean return on validation episodes, which choose among trees of several runs.
        is_champion: Whether it is its run's champion.
    """

    seed: int
    decision_nodes: int
    mean: float
    std: float
    validation_mean: float
    is_champion: bool


@dataclass(frozen=True)
class SizeRow:
    """The trees of one size.

    Attributes:
        decision_nodes: The size.
        trees: One of each run that has a tree of this size.
    """

    decision_nodes: int
    trees: tuple[SizedTree, ...]

    @property
    def median(self) -> float:
        """Median over runs of the mean test returns."""
        return float(np.median([tree.mean for tree in self.trees]))

    @property
    def in_validation(self) -> SizedTree:
        """The tree to take: the test is left out of the choice, so that what it says of the tree stays honest."""
        return max(self.trees, key=lambda tree: tree.validation_mean)

    @property
    def best_of_runs(self) -> SizedTree:
        """The tree with the best mean, chosen by the test itself."""
        return max(self.trees, key=lambda tree: tree.mean)

    @property
    def champions(self) -> int:
        """How many of the trees are their run's champion."""
        return sum(tree.is_champion for tree in self.trees)

    def as_dict(self) -> Mapping[str, object]:
        """Return plain values for JSON."""
        return {
            "decision_nodes": self.decision_nodes,
            "runs": len(self.trees),
            "median": self.median,
            "in_validation": self.in_validation.mean,
            "in_validation_seed": self.in_validation.seed,
            "best_of_runs": self.best_of_runs.mean,
            "best_of_runs_seed": self.best_of_runs.seed,
            "champions": self.champions,
        }


def trees_of_archive(
    records: Iterable[ArchiveRecord], seed: int, champion_decision_nodes: int
) -> Iterator[SizedTree]:
    """Yield what a run's archive says of its trees; one that was never tested is left out.

    Args:
        records: The archive.
        seed: Of the run.
        champion_decision_nodes: The champion is the best tree of its own size.
    """
    for record in records:
        if record.test_mean is None or record.test_std is None or record.validation_mean is None:
            continue
        yield SizedTree(
            seed,
            record.decision_nodes,
            record.test_mean,
            record.test_std,
            record.validation_mean,
            is_champion=record.decision_nodes == champion_decision_nodes,
        )


def by_size(trees: Iterable[SizedTree]) -> list[SizeRow]:
    """Return a row for each size that there is a tree of, from small to large.

    Args:
        trees: Of one environment and method.
    """
    of_size: dict[int, list[SizedTree]] = {}
    for tree in trees:
        of_size.setdefault(tree.decision_nodes, []).append(tree)
    return [SizeRow(size, tuple(of_size[size])) for size in sorted(of_size)]


_MANY_HEAD = (
    "decision nodes",
    "runs",
    "median",
    "best in validation",
    "its seed",
    "best of runs (chosen by this test)",
    "its seed",
    "champions",
)


def are_of_one_run(rows: Sequence[SizeRow]) -> bool:
    """Tell whether all trees are one run's, so that there is nothing to choose among runs."""
    return all(len(row.trees) == 1 for row in rows) and len({row.trees[0].seed for row in rows}) == 1


def sizes_table(rows: Sequence[SizeRow]) -> Table:
    """Return a row a size: of one run what its tree returns, of many what their trees return and which to take.

    Args:
        rows: From small to large.
    """
    if are_of_one_run(rows):
        return Table.of(
            ("decision nodes", "test mean ± sd", ""),
            (
                (str(tree.decision_nodes), f"{tree.mean:.2f} ± {tree.std:.2f}", "champion" * tree.is_champion)
                for row in rows
                for tree in row.trees
            ),
        ).without_empty_columns()
    return Table.of(
        _MANY_HEAD,
        (
            (
                str(row.decision_nodes),
                str(len(row.trees)),
                f"{row.median:.2f}",
                f"{row.in_validation.mean:.2f}",
                str(row.in_validation.seed),
                f"{row.best_of_runs.mean:.2f}",
                str(row.best_of_runs.seed),
                str(row.champions),
            )
            for row in rows
        ),
    )


def sizes_figure(methods: Mapping[str, Sequence[SizeRow]], *, title: str, solved_at: float | None) -> Figure:
    """Draw the test mean of the best trees against their size: a dot a run, a line through the medians.

    A lone leaf is left out where there are trees: it returns so little that they would all look the same.

    Args:
        methods: For each method, in the order of drawing, its rows.
        title: Stands above the figure.
        solved_at: Threshold to mark, or None.

    Raises:
        UserError: matplotlib is not installed.
    """
    figure, axes = new_axes(title, solved_at)
    sizes = {row.decision_nodes for rows in methods.values() for row in rows}
    sizes = sizes - {0} or sizes
    for (method, all_rows), colour in zip(methods.items(), run_colours(len(methods)), strict=True):
        rows = [row for row in all_rows if row.decision_nodes in sizes]
        for row in rows:
            means = [tree.mean for tree in row.trees]
            at = [row.decision_nodes] * len(means)
            axes.plot(at, means, color=colour, marker="o", markersize=3, alpha=0.5, linestyle="none")
        medians = [row.median for row in rows]
        axes.plot([row.decision_nodes for row in rows], medians, color=colour, label=f"{method}, median")
    axes.set(xlabel="decision nodes", ylabel="test mean")
    axes.set_xticks(sorted(sizes))
    legend_beside(figure)
    return figure
