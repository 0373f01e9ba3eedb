"""How a search went, as plain values for a page: fitness over generations, and what refinement changed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any

from ge_torchrl.artefacts.records import RefinementRecord
from ge_torchrl.report.figures import starts_of
from ge_torchrl.report.runs import Run
from ge_torchrl.report.unfinished import UnfinishedRun

_IMPROVED, _SKIPPED = "improved", "skipped"
# A table of more is no longer read.
_MOST_SHOWN = 100


def progress_values(run: Run | UnfinishedRun) -> dict[str, Any]:
    """Return a run's generations, refinements by generation, and the refinements that changed most."""
    return {
        "generations": [
            [record.generation, record.best, record.median_fitness, record.best_decision_nodes]
            for record in run.history
        ],
        "starts": sorted(starts_of([run])),
        "refinements": list(_by_generation(run.refinements)),
        "improved": [_values(record) for record in _largest(run.refinements)],
    }


def _by_generation(records: Sequence[RefinementRecord]) -> Iterator[dict[str, Any]]:
    applied = [record for record in records if record.outcome != _SKIPPED]
    for generation, group in groupby(applied, key=lambda record: record.generation):
        members = list(group)
        improved = [record for record in members if record.outcome == _IMPROVED]
        best = max(improved, key=_gain, default=None)
        yield {
            "generation": generation,
            "refined": len(members),
            "improved": len(improved),
            "new_best": any(record.new_best for record in members),
            "best": None if best is None else _values(best),
        }


def _largest(records: Sequence[RefinementRecord]) -> list[RefinementRecord]:
    """Return the refinements that gained most, in the order of the search."""
    improved = [record for record in records if record.outcome == _IMPROVED]
    largest = sorted(improved, key=_gain, reverse=True)[:_MOST_SHOWN]
    return sorted(largest, key=lambda record: record.generation)


def _gain(record: RefinementRecord) -> float:
    if record.return_after is None or record.return_before is None:
        return 0.0
    return record.return_after - record.return_before


def _values(record: RefinementRecord) -> dict[str, Any]:
    return {
        "generation": record.generation,
        "origin": record.origin,
        "nodes": record.decision_nodes,
        "before": record.return_before,
        "after": record.return_after,
        "moved": record.parameters_moved,
        "largest": record.largest_parameter_move,
        "leaves": record.leaves_changed,
        "written_back": record.written_back,
        "new_best": record.new_best,
    }
