"""The best fitness of runs over their generations, in the manner of the thesis' figure 4.1."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.artefacts.records import GenerationRecord
from ge_torchrl.report.canvas import new_axes, run_colours
from ge_torchrl.report.statistics import bootstrap_band

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


def convergence_figure(
    histories: Mapping[str, Sequence[Sequence[GenerationRecord]]],
    rng: np.random.Generator,
    *,
    title: str,
    solved_at: float | None,
) -> Figure:
    """Draw the mean best fitness over generations; bands are 95 % bootstrap intervals of the mean.

    A generation in which some run has no tree yet is left out. Compare the thesis' figures 4.1, 4.4 and 4.6.

    Args:
        histories: For each method, in the order of drawing, the generations of each of its runs.
        rng: Draws the resamples of the intervals.
        title: Stands above the figure.
        solved_at: Threshold to mark, or None.

    Raises:
        UserError: matplotlib is not installed.
    """
    figure, axes = new_axes(title, solved_at)
    for (method, runs), colour in zip(histories.items(), run_colours(len(histories)), strict=True):
        curves = best_curves(runs)
        generations = np.flatnonzero(np.isfinite(curves).all(axis=0))
        known = curves[:, generations]
        if len(runs) > 1:
            low, high = bootstrap_band(known, rng)
            axes.fill_between(generations, low, high, color=colour, alpha=0.18, linewidth=0)
        label = f"{method}, mean of {len(runs)} runs" if len(runs) > 1 else method
        axes.plot(generations, known.mean(axis=0), color=colour, label=label)
    axes.set(xlabel="generation", ylabel="best fitness", xmargin=0.01)
    axes.legend(frameon=False, loc="lower right")
    return figure
