"""Figures of many runs, in the manner of the thesis' figures 4.1 and 4.2."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.records import GenerationRecord, RefinementRecord
from ge_torchrl.report.canvas import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, new_figure
from ge_torchrl.report.methods import refiner_of
from ge_torchrl.report.runs import Pair
from ge_torchrl.report.statistics import SolvingTime, best_of, bootstrap_band

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

RUN_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)

_DOT: dict[str, Any] = {"color": BLUE, "markersize": 5, "linestyle": "none"}
_RING: dict[str, Any] = {
    "color": VERMILION,
    "markersize": 9,
    "markerfacecolor": "none",
    "markeredgewidth": 1.6,
    "linestyle": "none",
}
_OPEN: dict[str, Any] = {"color": "black", "marker": "o", "markerfacecolor": "white", "linestyle": "none"}

# Of more refinements than these the new bests alone are marked.
_MOST_RINGS = 12


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
        values = [np.nan if (best := best_of(record)) is None else best for record in history]
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
    figure, axes = _axes(title, solved_at)
    for (method, runs), colour in zip(histories.items(), _cycled(len(histories)), strict=True):
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


def pairs_figure(pairs: Sequence[Pair], *, title: str, solved_at: float | None) -> Figure:
    """Draw single runs, with refined trees solid and GE alone dotted, the same seed in the same colour.

    A ring marks a generation with a refinement; in a run with many of them, one whose refinement was a new best.
    Compare the thesis' figure 4.2, which shows three pairs.

    Args:
        pairs: A few pairs of one environment and method, at least one.
        title: Stands above the figure.
        solved_at: Threshold to mark, or None.

    Raises:
        UserError: matplotlib is not installed.
    """
    from matplotlib.lines import Line2D

    figure, axes = _axes(title, solved_at)
    figure.set_figwidth(8.0)
    for (refined, plain), colour in zip(pairs, _cycled(len(pairs)), strict=True):
        solid, dotted = (best_curves([run.history])[0] for run in (refined, plain))
        axes.plot(dotted, color=colour, linestyle=":", linewidth=1.6)
        axes.plot(solid, color=colour, label=f"seed {refined.seed}")
        rings = _ringed(refined.refinements)
        axes.plot(rings, solid[rings], **{**_OPEN, "color": colour})
    axes.set(xlabel="generation", ylabel="best fitness", xmargin=0.01)
    meanings = [
        Line2D([], [], color="black", label=pairs[0].method),
        Line2D([], [], color="black", linestyle=":", linewidth=1.6, label="GE alone"),
        Line2D([], [], label=refiner_of(pairs[0].method), **_OPEN),
    ]
    # Beside the axes, as single runs leave no corner free.
    handles = [*axes.get_legend_handles_labels()[0], *meanings]
    figure.legend(handles=handles, frameon=False, loc="outside right upper")
    return figure


def solving_figure(pairs: Sequence[Pair], *, title: str, solved_at: float) -> Figure:
    """Draw for every seed after how many generations each method reached the threshold.

    An arrow stands for a run that never did, at the generations it ran.

    Args:
        pairs: Pairs of one environment and method, at least one.
        title: Stands above the figure.
        solved_at: The threshold.

    Raises:
        UserError: matplotlib is not installed.
    """
    figure = new_figure(6.4, 1.5 + 0.3 * len(pairs))
    axes = figure.add_subplot()
    axes.set_title(title, loc="left")
    for row, (refined, plain) in enumerate(pairs):
        treated, alone = (run.solving_time(solved_at) for run in (refined, plain))
        axes.plot([alone.generations, treated.generations], [row, row], color=GREY, zorder=1)
        # A ring around a dot: both are seen where they meet.
        axes.plot(alone.generations, row, marker=_marker(alone), **_RING)
        axes.plot(treated.generations, row, marker=_marker(treated), **_DOT)
    axes.plot([], [], marker="o", label=pairs[0].method, **_DOT)
    axes.plot([], [], marker="o", label="GE alone", **_RING)
    axes.plot([], [], color="black", marker=">", linestyle="none", label="not within the run")
    axes.set_yticks(range(len(pairs)), [f"seed {refined.seed}" for refined, _ in pairs])
    axes.set(
        xlabel=f"generations until the best fitness reaches {solved_at:g}", ylim=(len(pairs) - 0.5, -0.5)
    )
    longest = max(run.solving_time(solved_at).generations for pair in pairs for run in pair)
    axes.set_xlim(0, 1.04 * longest)
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper right", ncols=3, frameon=False)
    figure.set_layout_engine("constrained")
    return figure


def _axes(title: str, solved_at: float | None) -> tuple[Figure, Axes]:
    figure = new_figure(6.4, 4.0)
    figure.set_layout_engine("constrained")
    axes = figure.add_subplot()
    axes.set_title(title, loc="left")
    axes.spines[["top", "right"]].set_visible(False)
    if solved_at is not None:
        axes.axhline(
            solved_at, color="black", linestyle="--", linewidth=1, label=f"solved from {solved_at:g}"
        )
    return figure, axes


def _ringed(records: Sequence[RefinementRecord]) -> list[int]:
    """Return the generations to mark."""
    applied = [record for record in records if record.outcome != "skipped"]
    told = applied if len(applied) <= _MOST_RINGS else [record for record in applied if record.new_best]
    return sorted({record.generation for record in told})


def _marker(time: SolvingTime) -> str:
    return ">" if time.censored else "o"


def _cycled(n: int) -> list[str]:
    return [RUN_COLOURS[i % len(RUN_COLOURS)] for i in range(n)]
