"""Figures of pairs of runs, in the manner of the thesis' figure 4.2."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ge_torchrl.report.canvas import BLUE, GREY, VERMILION, legend_beside, new_axes, new_figure, run_colours
from ge_torchrl.report.figures import best_curves, broken_at, starts_of
from ge_torchrl.report.methods import refiner_of
from ge_torchrl.report.runs import Run
from ge_torchrl.report.thesis.pairs import Pair
from ge_torchrl.report.thesis.solving import SolvingTime

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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


def pairs_figure(pairs: Sequence[Pair], *, title: str, solved_at: float | None) -> Figure:
    """Draw single runs, the treated ones solid and GE alone dotted, the same seed in the same colour.

    A ring marks a generation with a refinement; in a run with many of them, one whose refinement was a new best. A line
    breaks where the run begins anew.
    Compare the thesis' figure 4.2, which shows three pairs.

    Args:
        pairs: A few pairs of one environment and method, at least one.
        title: Stands above the figure.
        solved_at: Threshold to mark, or None.

    Raises:
        UserError: matplotlib is not installed.
    """
    from matplotlib.lines import Line2D

    figure, axes = new_axes(title, solved_at)
    for (treated, plain), colour in zip(pairs, run_colours(len(pairs)), strict=True):
        solid, dotted = (best_curves([run.history])[0] for run in (treated, plain))
        dotted_line, solid_line = (
            broken_at(starts_of([run]), np.arange(len(curve)), curve)
            for run, curve in ((plain, dotted), (treated, solid))
        )
        axes.plot(*dotted_line, color=colour, linestyle=":", linewidth=1.6)
        axes.plot(*solid_line, color=colour, label=f"seed {treated.seed}")
        rings = ringed(treated)
        axes.plot(rings, solid[rings], **{**_OPEN, "color": colour})
    axes.set(xlabel="generation", ylabel="best fitness", xmargin=0.01)
    meanings = [
        Line2D([], [], color="black", label=pairs[0].method),
        Line2D([], [], color="black", linestyle=":", linewidth=1.6, label="GE alone"),
    ]
    if any(ringed(pair.treated) for pair in pairs):
        meanings.append(Line2D([], [], label=refiner_of(pairs[0].method), **_OPEN))
    legend_beside(figure, [*axes.get_legend_handles_labels()[0], *meanings])
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
    for row, pair in enumerate(pairs):
        treated, alone = pair.solving_times(solved_at)
        axes.plot([alone.generations, treated.generations], [row, row], color=GREY, zorder=1)
        # A ring around a dot: both are seen where they meet.
        axes.plot(alone.generations, row, marker=_marker(alone), **_RING)
        axes.plot(treated.generations, row, marker=_marker(treated), **_DOT)
    axes.plot([], [], marker="o", label=pairs[0].method, **_DOT)
    axes.plot([], [], marker="o", label="GE alone", **_RING)
    times = [pair.solving_times(solved_at) for pair in pairs]
    for place, (method, looks) in enumerate(((pairs[0].method, _DOT), ("GE alone", _RING))):
        if any(both[place].censored for both in times):
            axes.plot([], [], marker=">", label=f"{method}, not within the run", **looks)
    axes.set_yticks(range(len(pairs)), [f"seed {pair.treated.seed}" for pair in pairs])
    axes.set(
        xlabel=f"generations until the best fitness reaches {solved_at:g}", ylim=(len(pairs) - 0.5, -0.5)
    )
    longest = max(time.generations for both in times for time in both)
    axes.set_xlim(0, 1.04 * longest)
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper right", ncols=2, frameon=False)
    figure.set_layout_engine("constrained")
    return figure


def ringed(run: Run) -> list[int]:
    """Return the generations of a run that get a ring."""
    applied = [record for record in run.refinements if record.outcome != "skipped"]
    told = applied if len(applied) <= _MOST_RINGS else [record for record in applied if record.new_best]
    return sorted({record.generation for record in told})


def _marker(time: SolvingTime) -> str:
    return ">" if time.censored else "o"
