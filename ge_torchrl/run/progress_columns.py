"""The columns of a run's progress: their titles, their widths and what stands in them."""

from __future__ import annotations

from ge_torchrl.artefacts.records import GenerationRecord
from ge_torchrl.config import Config
from ge_torchrl.run.refinement_lines import number
from ge_torchrl.run.remaining import duration, rate

_GENERATION, _BEST, _MEDIAN, _NODES = "gen", "best", "median", "splits"
_REFINED, _POLISHED, _RATE, _LEFT = "refined", "polished", "steps/s", "left"
# All columns with two blanks between them fit a terminal of 72.
_WIDTHS = {
    _GENERATION: 5,
    _BEST: 8,
    _MEDIAN: 8,
    _NODES: 6,
    _REFINED: 7,
    _POLISHED: 8,
    _RATE: 8,
    _LEFT: 7,
}


def titles(config: Config) -> tuple[str, ...]:
    """Return the titles; trees are counted where there will be any."""
    counts = (_REFINED,) * config.refiner.enabled + (_POLISHED,) * config.polish.enabled
    return _GENERATION, _BEST, _MEDIAN, _NODES, *counts, _RATE, _LEFT


def cells(
    columns: tuple[str, ...], record: GenerationRecord, steps_per_second: float, left: float
) -> list[str]:
    """Return what stands in the columns for a generation.

    Args:
        columns: Their titles.
        record: The generation.
        steps_per_second: How fast the search went until then.
        left: Seconds that the run was expected to take after it.
    """
    said = {
        _GENERATION: str(record.generation),
        _BEST: number(record.best),
        _MEDIAN: number(record.median_fitness),
        _NODES: "-" if record.best_decision_nodes is None else str(record.best_decision_nodes),
        _REFINED: f"{record.refined:,}",
        _POLISHED: f"{record.polished:,}",
        _RATE: rate(steps_per_second),
        _LEFT: duration(left),
    }
    return [said[title] for title in columns]


def aligned(columns: tuple[str, ...], texts: list[str]) -> str:
    """Return a line of plain output: texts under their titles."""
    return "  ".join(text.rjust(_WIDTHS[title]) for title, text in zip(columns, texts, strict=True))
