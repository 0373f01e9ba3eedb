"""Tables: cells that a terminal and Markdown show alike, and the one table of runs."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from types import MappingProxyType
from typing import Literal, NamedTuple, Self

import numpy as np

from ge_torchrl.artefacts.records import Summary

Form = Literal["terminal", "plain", "markdown"]
"""Where a table is read: on a terminal, in a file or a pipe, or as Markdown."""


class Table(NamedTuple):
    """A table of texts.

    Attributes:
        head: A title for each column.
        rows: Cells, as many in each row as there are titles.
    """

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @classmethod
    def of(cls, head: Iterable[str], rows: Iterable[Iterable[str]]) -> Self:
        """Return the table of these titles and cells."""
        return cls(tuple(head), tuple(map(tuple, rows)))

    def beside(self, other: Table) -> Table:
        """Return this table with the columns of another to its right."""
        pairs = zip(self.rows, other.rows, strict=True)
        return Table(self.head + other.head, tuple(left + right for left, right in pairs))

    def without_empty_columns(self) -> Table:
        """Return the columns in which some row has a text."""
        shown = [n for n in range(len(self.head)) if any(row[n] for row in self.rows)]
        return Table.of((self.head[n] for n in shown), ((row[n] for n in shown) for row in self.rows))

    def markdown(self) -> str:
        """Return Markdown, all columns but the first aligned to the right."""
        cells = [[cell.replace("|", "\\|").replace("<", "\\<") for cell in row] for row in self.rows]
        lines = [self.head, ("---", *["---:"] * (len(self.head) - 1)), *cells]
        return "\n".join(f"| {' | '.join(line)} |" for line in lines)

    def aligned(self) -> str:
        """Return plain lines, all columns aligned to the right."""
        lines = [self.head, *self.rows]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        return "\n".join(
            "  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
            for line in lines
        )

    def told(self, form: Form) -> str:
        """Return the table in the form of where it is read."""
        return _DRAWINGS[form](self)

    def drawn(self) -> str:
        """Return lines for a terminal: a head that stands out, and columns that fit into its width."""
        from rich import box
        from rich.console import Console
        from rich.table import Table as RichTable

        table = RichTable(box=box.SIMPLE_HEAD, pad_edge=False)
        for title in self.head:
            table.add_column(title, justify="right", overflow="fold")
        for row in self.rows:
            table.add_row(*row)
        # Of the terminal: rich asks its size, and NO_COLOR.
        console = Console(file=io.StringIO(), force_terminal=True, highlight=False, markup=False)
        with console.capture() as captured:
            console.print(table)
        return "\n".join(line.rstrip() for line in captured.get().splitlines() if line.strip())


_DRAWINGS: Mapping[Form, Callable[[Table], str]] = MappingProxyType(
    {"terminal": Table.drawn, "plain": Table.aligned, "markdown": Table.markdown}
)


def counted(n: int, thing: str) -> str:
    """Return a number with what it counts, such as "1 tree" or "2,000 trees"."""
    return f"1 {thing}" if n == 1 else f"{n:,} {thing}s"


@dataclass(frozen=True)
class RunRow:
    """A run, its champion and what a test said of it; what is not known is None.

    Attributes:
        seed: Of the run.
        decision_nodes: Of the champion.
        mean: Its mean test return.
        std: Standard deviation of its test returns.
        solved: Whether the mean reaches the threshold; None where there is none.
        wall_seconds: Clock time of the whole run.
        evolve_seconds: Clock time of the search.
        complexity_M: The champion's complexity by Eq. 4.
        train_fitness: Its fitness on its few training episodes.
    """

    seed: int
    decision_nodes: int
    mean: float
    std: float
    solved: bool | None
    wall_seconds: float
    evolve_seconds: float | None = field(default=None, kw_only=True)
    complexity_M: float | None = field(default=None, kw_only=True)  # noqa: N815 (the paper's symbol)
    train_fitness: float | None = field(default=None, kw_only=True)

    @classmethod
    def of(cls, summary: Summary) -> Self:
        """Return the row of a finished run."""
        return cls(
            summary.seed,
            summary.decision_nodes,
            summary.test_mean,
            summary.test_std,
            summary.solved,
            summary.wall_seconds,
            evolve_seconds=summary.evolve_seconds,
            complexity_M=summary.complexity_M,
            train_fitness=summary.train_fitness,
        )


_RUNS_HEAD = ("seed", "decision nodes", "M", "training", "test mean ± sd", "solved", "search s", "all s")


def runs_table(runs: Sequence[RunRow]) -> Table:
    """Return a row a run and a last row over all of them; a column that no run fills is left out.

    The form is that of Tables 4.3, 4.6 and 4.9 of the thesis: training and test fitness of the best tree and its
    complexity, with the size and the time that the thesis does not give.

    Args:
        runs: Runs of one environment and method, at least one.
    """
    cells = (
        (
            str(run.seed),
            str(run.decision_nodes),
            _shown(run.complexity_M, 1),
            _shown(run.train_fitness, 2),
            f"{run.mean:.2f} ± {run.std:.2f}",
            yes_or_no(run.solved),
            _shown(run.evolve_seconds, 1),
            _shown(run.wall_seconds, 1),
        )
        for run in runs
    )
    return Table.of(_RUNS_HEAD, chain(cells, [_over_all(runs)])).without_empty_columns()


def _over_all(runs: Sequence[RunRow]) -> Iterator[str]:
    yield "all"
    yield _shown(_mean(run.decision_nodes for run in runs), 1)
    yield _shown(_mean(run.complexity_M for run in runs), 1)
    yield _shown(_mean(run.train_fitness for run in runs), 2)
    yield _shown(_mean(run.mean for run in runs), 2)
    judged = [run.solved for run in runs if run.solved is not None]
    yield f"{sum(judged)} of {len(judged)}" if judged else ""
    yield _shown(_mean(run.evolve_seconds for run in runs), 1)
    yield _shown(_mean(run.wall_seconds for run in runs), 1)


def yes_or_no(answer: bool | None) -> str:
    """Return an answer as a cell; an empty one where nothing was asked."""
    return "" if answer is None else "yes" if answer else "no"


def _shown(value: float | None, decimals: int) -> str:
    return "" if value is None else f"{value:.{decimals}f}"


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None
