"""Figures of pairs of runs, in the manner of the thesis' figure 4.2."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ge_torchrl.artefacts.records import RefinementRecord
from ge_torchrl.report.canvas import BLUE, GREY, VERMILION, new_axes, new_figure, run_colours
from ge_torchrl.report.figures import best_curves
from ge_torchrl.report.methods import added_by
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

    figure, axes = new_axes(title, solved_at)
    figure.set_figwidth(8.0)
    for (treated, plain), colour in zip(pairs, run_colours(len(pairs)), strict=True):
        solid, dotted = (best_curves([run.history])[0] for run in (treated, plain))
        axes.plot(dotted, color=colour, linestyle=":", linewidth=1.6)
        axes.plot(solid, color=colour, label=f"seed {treated.seed}")
        rings = _ringed(treated.refinements)
        axes.plot(rings, solid[rings], **{**_OPEN, "color": colour})
    axes.set(xlabel="generation", ylabel="best fitness", xmargin=0.01)
    meanings = [
        Line2D([], [], color="black", label=pairs[0].method),
        Line2D([], [], color="black", linestyle=":", linewidth=1.6, label="GE alone"),
        Line2D([], [], label=added_by(pairs[0].method), **_OPEN),
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
    for row, pair in enumerate(pairs):
        treated, alone = pair.solving_times(solved_at)
        axes.plot([alone.generations, treated.generations], [row, row], color=GREY, zorder=1)
        # A ring around a dot: both are seen where they meet.
        axes.plot(alone.generations, row, marker=_marker(alone), **_RING)
        axes.plot(treated.generations, row, marker=_marker(treated), **_DOT)
    axes.plot([], [], marker="o", label=pairs[0].method, **_DOT)
    axes.plot([], [], marker="o", label="GE alone", **_RING)
    axes.plot([], [], color="black", marker=">", linestyle="none", label="not within the run")
    axes.set_yticks(range(len(pairs)), [f"seed {pair.treated.seed}" for pair in pairs])
    axes.set(
        xlabel=f"generations until the best fitness reaches {solved_at:g}", ylim=(len(pairs) - 0.5, -0.5)
    )
    longest = max(time.generations for pair in pairs for time in pair.solving_times(solved_at))
    axes.set_xlim(0, 1.04 * longest)
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper right", ncols=3, frameon=False)
    figure.set_layout_engine("constrained")
    return figure


def _ringed(records: Sequence[RefinementRecord]) -> list[int]:
    """Return the generations to mark."""
    applied = [record for record in records if record.outcome != "skipped"]
    told = applied if len(applied) <= _MOST_RINGS else [record for record in applied if record.new_best]
    return sorted({record.generation for record in told})


def _marker(time: SolvingTime) -> str:
    return ">" if time.censored else "o"
