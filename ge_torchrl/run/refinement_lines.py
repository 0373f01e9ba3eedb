"""What the screen of a run says of refined trees, a line each."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ge_torchrl.artefacts.records import RefinementRecord
from ge_torchrl.config import Config
from ge_torchrl.report.tables import counted

# Of more gains these are told.
_SHOWN = 6


def planned_refinements(config: Config) -> int:
    """Return how many trees will be refined at most, those proposed by the archive included."""
    if not config.refiner.enabled:
        return 0
    scheduled = sum(map(config.refiner.schedule.applies_to, range(config.ge.generations)))
    proposals = config.archive.neighbours + (config.archive.revisit_factor > 0)
    return scheduled * (config.refiner.candidates + proposals)


def refinement_line(record: RefinementRecord, refiner: str) -> str:
    """Return what became of a tree.

    Args:
        record: The refinement.
        refiner: What the method is called.
    """
    front = f"generation {record.generation}  {refiner}:"
    if record.outcome == "skipped":
        tried = f" in {counted(record.redraws, 'redraw')}" * (record.redraws > 0)
        return f"{front} skipped, no tree could be a candidate{tried}"
    what = f"{front} {_described(record)} of {counted(record.decision_nodes or 0, 'node')}"
    if record.outcome == "failed":
        return f"{what} kept as it was, {record.failure}, {record.refine_seconds:.1f} s"
    verdict = "new best" if record.new_best else record.outcome.replace("_", " ")
    return (
        f"{what}, {number(record.return_before)} -> {number(record.return_after)} on unseen episodes, "
        f"{verdict}, {record.refine_seconds:.1f} s"
    )


def _described(record: RefinementRecord) -> str:
    match record.origin:
        case "neighbour":
            return "neighbour"
        case "archive":
            return "kept tree"
        case _:
            return f"{record.chosen} tree" if record.chosen else "tree"


def bettered(before: Mapping[int, float], after: Mapping[int, float]) -> str:
    """Return which of the best trees by their number of decision nodes a last refinement has bettered.

    Args:
        before: Their fitness.
        after: Theirs afterwards.
    """
    better = {nodes: fitness for nodes, fitness in after.items() if fitness > before.get(nodes, -math.inf)}
    told = f"kept trees of {counted(sum(nodes > 0 for nodes in before), 'size')} refined once more"
    if not better:
        return f"{told}, none became better"
    gains = [
        f"{nodes}: {number(before.get(nodes))} -> {number(fitness)}" for nodes, fitness in better.items()
    ]
    shown = [*gains[:_SHOWN], *(["..."] if len(gains) > _SHOWN else [])]
    return f"{told}, {len(better)} became better; by decision nodes {', '.join(shown)}"


def number(value: float | None) -> str:
    """Return a return or a fitness with two decimals; a dash where there is none."""
    return "-" if value is None else f"{value:.2f}"
