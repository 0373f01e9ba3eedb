"""Figures without a display: made, and saved as SVG and PNG whose bytes depend on the content alone.

matplotlib is an extra and is imported only here and where something is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from ge_torchrl.errors import ArtefactError, UserError

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's colours, which people of all kinds of colour vision tell apart.
BLUE, ORANGE, GREEN, VERMILION = "#0072B2", "#E69F00", "#009E73", "#D55E00"
SKY, PURPLE, YELLOW, GREY = "#56B4E9", "#CC79A7", "#F0E442", "#999999"
_RUN_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)

PLOTS_HINT = 'figures need matplotlib; expected it installed: pip install -c constraints.txt -e ".[plots]"'

_DPI = 150
# An Agg image has less than 2^16 pixels a side; a long tree is drawn with fewer dots an inch instead.
_MOST_PIXELS = 20_000


def has_matplotlib() -> bool:
    """Return whether figures can be drawn."""
    return find_spec("matplotlib") is not None


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of this size in inches.

    Raises:
        UserError: matplotlib is not installed.
    """
    if not has_matplotlib():
        raise UserError(PLOTS_HINT)
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    return figure


def new_axes(title: str, solved_at: float | None) -> tuple[Figure, Axes]:
    """Return a figure with empty axes, with a dashed line where a task counts as solved.

    Args:
        title: Stands above the axes.
        solved_at: The threshold, or None.

    Raises:
        UserError: matplotlib is not installed.
    """
    figure = new_figure(6.4, 4.0)
    figure.set_layout_engine("constrained")
    axes = figure.add_subplot()
    # A name is no formula, whatever signs of a dollar it has.
    axes.set_title(title, loc="left", parse_math=False)
    axes.spines[["top", "right"]].set_visible(False)
    if solved_at is not None:
        label = f"solved from {solved_at:g}"
        axes.axhline(solved_at, color="black", linestyle="--", linewidth=1, label=label)
    return figure, axes


def legend_beside(figure: Figure, handles: Sequence[Artist] | None = None) -> None:
    """Put the legend beside the axes, where it covers no curve.

    Args:
        figure: A figure of `new_axes`; it becomes wider.
        handles: What the legend explains; None for all that has a label.
    """
    figure.set_figwidth(8.0)
    legend = figure.legend(
        handles=handles or figure.axes[0].get_legend_handles_labels()[0],
        frameon=False,
        loc="outside right upper",
    )
    for text in legend.get_texts():
        text.set_parse_math(False)


def run_colours(n: int) -> list[str]:
    """Return colours for so many runs or methods; beyond six they begin again."""
    return [_RUN_COLOURS[i % len(_RUN_COLOURS)] for i in range(n)]


def save_figure(figure: Figure, path: Path) -> tuple[Path, Path]:
    """Write a figure as SVG and as PNG; equal figures give equal bytes.

    Args:
        figure: The figure.
        path: Path of the files without suffix; its folder is made.

    Returns:
        Paths of the SVG and of the PNG.

    Raises:
        ArtefactError: The files cannot be written.
    """
    from matplotlib import rc_context

    svg, png = (path.with_name(path.name + suffix) for suffix in (".svg", ".png"))
    dpi = min(_DPI, _MOST_PIXELS / max(figure.get_size_inches()))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # The salt names the clip paths of an SVG, which would be random.
        with rc_context({"svg.hashsalt": "ge_torchrl"}):
            figure.savefig(svg, metadata={"Date": None, "Creator": None})
        figure.savefig(png, dpi=dpi, metadata={"Software": None})
    except OSError as error:
        raise ArtefactError(f"{path} cannot be written: {error.strerror}") from error
    return svg, png
