"""The thesis' numbers as columns at the right of ours."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from ge_torchrl.report.methods import THESIS
from ge_torchrl.report.tables import Table, yes_or_no
from ge_torchrl.report.thesis.published import PUBLISHED, PublishedRun, PublishedSweep

_RUN_COLUMNS = ("thesis", "training", "test", "M", "solved")
_SHORT_COLUMNS = ("thesis: solved", "mean test", "mean M")


def published_beside(method: str, environment: str) -> PublishedSweep | None:
    """Return the thesis' runs to stand beside those of a method; it has runs of its own settings alone."""
    return PUBLISHED.get(environment) if method == THESIS else None


def published_columns(published: PublishedSweep, seeds: Iterable[int]) -> Table:
    """Return for each seed the thesis' run of that number, and in a last row its means.

    Args:
        published: The thesis' runs.
        seeds: One a row; the thesis' R1 has seed 0.
    """
    rows = [_run_cells(published, published.run_of_seed(seed)) for seed in seeds]
    return Table.of(_RUN_COLUMNS, [*rows, ["all", *_numbers(*_means(published)), _solved(published)]])


def published_in_short(sweeps: Iterable[PublishedSweep | None]) -> Table:
    """Return a row for each of ours: the thesis' solved runs, mean test return and mean M, or empty cells."""
    return Table.of(_SHORT_COLUMNS, map(_short_cells, sweeps))


def source_of(published: PublishedSweep) -> str:
    """Return where the numbers are from, and how to read them."""
    return (
        f"Thesis: Table {published.table}. A seed does not make the same run in two programs: compare columns, not "
        "rows. The thesis' means are of all its runs."
    )


def refinements_of(published: PublishedSweep) -> str:
    """Return what the thesis says of its applications of PPO."""
    return f"* Thesis: {published.refinements_in_words}."


def _run_cells(published: PublishedSweep, run: PublishedRun | None) -> Iterator[str]:
    if run is None:
        yield from [""] * len(_RUN_COLUMNS)
        return
    yield f"R{run.number}"
    yield from _numbers(run.train_fitness, run.test_mean, run.complexity_M)
    yield yes_or_no(published.is_solved(run))


def _short_cells(published: PublishedSweep | None) -> Sequence[str]:
    if published is None:
        return [""] * len(_SHORT_COLUMNS)
    _, test, complexity = _numbers(*_means(published))
    return [_solved(published), test, complexity]


def _means(published: PublishedSweep) -> Iterator[float]:
    columns = zip(
        *((run.train_fitness, run.test_mean, run.complexity_M) for run in published.runs), strict=True
    )
    return (float(np.mean(column)) for column in columns)


def _solved(published: PublishedSweep) -> str:
    return f"{published.solved} of {len(published.runs)}"


def _numbers(train_fitness: float, test_mean: float, complexity: float) -> list[str]:
    return [f"{train_fitness:.2f}", f"{test_mean:.2f}", f"{complexity:.1f}"]
