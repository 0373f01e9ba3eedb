"""The best fitness of runs over their generations, in the manner of the thesis' figure 4.1."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.artefacts.records import GenerationRecord
from ge_torchrl.report.canvas import legend_beside, new_axes, run_colours
from ge_torchrl.report.runs import Run
from ge_torchrl.report.statistics import spread_band
from ge_torchrl.report.unfinished import UnfinishedRun
from ge_torchrl.search.restarts import begins_anew

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def best_curves(histories: Sequence[Sequence[GenerationRecord]]) -> NDArray[np.float64]:
    """Return the best fitness of every generation, refined trees included, one row a run.

    A run that ended early keeps its last value; a generation without any tree has NaN.

    Args:
        histories: The runs' generations; none is empty.

    Returns:
        [R, T] float64, `T` the length of the longest run.
    """
    curves = np.full((len(histories), max(map(len, histories))), np.nan)
    for row, history in zip(curves, histories, strict=True):
        values = [np.nan if record.best is None else record.best for record in history]
        row[: len(values)], row[len(values) :] = values, values[-1]
    return curves


def starts_of(runs: Iterable[Run | UnfinishedRun]) -> set[int]:
    """Return the generations with which some of these runs begin anew with another population."""
    return {
        generation
        for run in runs
        for generation in range(1, run.config.ge.generations)
        if begins_anew(run.config.ge, generation)
    }


def broken_at(
    starts: Collection[int], generations: NDArray[Any], *curves: NDArray[np.float64]
) -> tuple[NDArray[np.float64], ...]:
    """Return generations and curves with a gap before each start, so that no line leads from one to the next.

    Args:
        starts: The generations that no line is to lead to.
        generations: [T] in their order.
        curves: [T] each.
    """
    gaps = np.flatnonzero(np.isin(generations, list(starts)) & (np.arange(len(generations)) > 0))
    return tuple(np.insert(values.astype(np.float64), gaps, np.nan) for values in (generations, *curves))


def convergence_figure(
    histories: Mapping[str, Sequence[Sequence[GenerationRecord]]],
    rng: np.random.Generator,
    *,
    title: str,
    solved_at: float | None,
    starts: Mapping[str, Collection[int]] = MappingProxyType({}),
) -> Figure:
    """Draw the mean best fitness over generations; bands are 95 % bootstrap intervals of the mean.

    Of fewer than five runs a band is what they span. A generation in which some run has no tree yet is left out, and a
    line breaks where runs begin anew.
    Compare the thesis' figures 4.1, 4.4 and 4.6.

    Args:
        histories: For each method, in the order of drawing, the generations of each of its runs.
        rng: Draws the resamples of the intervals.
        title: Stands above the figure.
        solved_at: Threshold to mark, or None.
        starts: For each method the generations with which its runs begin anew.

    Raises:
        UserError: matplotlib is not installed.
    """
    figure, axes = new_axes(title, solved_at)
    for (method, runs), colour in zip(histories.items(), run_colours(len(histories)), strict=True):
        curves, anew = best_curves(runs), starts.get(method, ())
        generations = np.flatnonzero(np.isfinite(curves).all(axis=0))
        known = curves[:, generations]
        if len(runs) > 1:
            low, high = spread_band(known, rng)
            across, low, high = broken_at(anew, generations, low, high)
            axes.fill_between(across, low, high, color=colour, alpha=0.18, linewidth=0)
        label = f"{method}, mean of {len(runs)} runs" if len(runs) > 1 else method
        across, mean = broken_at(anew, generations, known.mean(axis=0))
        axes.plot(across, mean, color=colour, label=label)
    axes.set(xlabel="generation", ylabel="best fitness", xmargin=0.01)
    legend_beside(figure)
    return figure
