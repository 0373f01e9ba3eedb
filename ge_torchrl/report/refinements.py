"""What refinement did to trees: counted by origin, and what was lost on the way."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ge_torchrl.artefacts.records import RefinementRecord
from ge_torchrl.report.methods import refiner_of
from ge_torchrl.report.runs import Run
from ge_torchrl.report.tables import Table, counted

_ORIGINS = {"individual": "individuals", "neighbour": "neighbours", "archive": "of the archive"}


class Bridges(NamedTuple):
    """Mean returns of trees on their way through a refinement, of the applications where all are known.

    Attributes:
        applications: Their number.
        before: Of the tree as it was, on the measuring episodes.
        soft: Of the soft tree in the last update; None where the method knows no soft trees.
        after: Of the refined tree on the measuring episodes.
        snapped: Likewise, of what the grammar's constants leave of it.
    """

    applications: int
    before: float
    soft: float | None
    after: float
    snapped: float

    @property
    def lost_in_hardening(self) -> float | None:
        """How much less the hard tree returns than the soft one; None where there is no soft one."""
        return None if self.soft is None else self.soft - self.after

    @property
    def lost_in_snapping(self) -> float:
        """How much less the snapped tree returns than the refined one."""
        return self.after - self.snapped


@dataclass(frozen=True)
class RefinementCounts:
    """Refinements, of one run or of many.

    Attributes:
        applied: Trees that were refined, failures included.
        beyond_fitness: Those whose return after exceeds the fitness before, as the thesis counts. The one is
            measured on many unseen episodes, the other on the few training episodes.
        beyond_return: Those whose return after exceeds the return before, on the same unseen episodes.
        below_return: Those whose return after is below the return before.
        new_best: Those that became the best of their generation.
        written_back: Those that, snapped to the grammar's constants, took their source's place in the population.
        moved_parameters: Those that changed a number of the tree.
        changed_leaves: Those that changed a leaf's action.
        failed: Those whose training broke off.
        skipped: Times that no candidate was found; they are not in `applied`.
        timesteps: Environment steps sampled.
        bridges: What was lost on the way; None where no refined tree was snapped.
    """

    applied: int
    beyond_fitness: int
    beyond_return: int
    below_return: int
    new_best: int
    written_back: int
    moved_parameters: int
    changed_leaves: int
    failed: int
    skipped: int
    timesteps: int
    bridges: Bridges | None


def count_refinements(records: Iterable[RefinementRecord]) -> RefinementCounts:
    """Count refinements.

    Args:
        records: Of one run or of many, all of one method.
    """
    every = list(records)
    applied = [record for record in every if record.outcome != "skipped"]
    return RefinementCounts(
        applied=len(applied),
        beyond_fitness=sum(_exceeds(record.return_after, record.fitness_before) for record in applied),
        beyond_return=sum(_exceeds(record.return_after, record.return_before) for record in applied),
        below_return=sum(_exceeds(record.return_before, record.return_after) for record in applied),
        new_best=sum(record.new_best for record in applied),
        written_back=sum(record.written_back for record in applied),
        moved_parameters=sum(bool(record.parameters_moved) for record in applied),
        changed_leaves=sum(bool(record.leaves_changed) for record in applied),
        failed=sum(record.outcome == "failed" for record in applied),
        skipped=len(every) - len(applied),
        timesteps=sum(record.timesteps or 0 for record in applied),
        bridges=_bridges(applied),
    )


def refinements_text(runs: Sequence[Run]) -> str:
    """Return how many refinements improved a tree, by origin, and what was lost on the way.

    Args:
        runs: Runs of one method with a refiner in one environment.
    """
    records = [record for run in runs for record in run.refinements]
    counts = count_refinements(records)
    refiner = refiner_of(runs[0].method)
    lines = [] if counts.bridges is None else [_bridges_line(counts.bridges)]
    lines.append(_champions_line(runs, is_written_back=counts.written_back > 0))
    if polished := sum(run.summary.polished for run in runs):
        seconds = np.mean([run.summary.polish_seconds for run in runs])
        lines.append(
            f"* Besides, {polished:,} trees were polished by local search, {polished / len(runs):,.0f} a run in "
            f"{seconds:.1f} s."
        )
    if counts.skipped:
        were = "was" if counts.skipped == 1 else "were"
        lines.append(f"* {counts.skipped:,} more {were} skipped, as no tree could be a candidate.")
    if counts.applied == 0:
        return "\n".join([f"* {refiner} refined no tree in {counted(len(runs), 'run')}.", *lines])
    return f"{_counts_table(records, refiner).markdown()}\n\n" + "\n".join(lines)


def _counts_table(records: Sequence[RefinementRecord], refiner: str) -> Table:
    """Return a row a way of counting, and a column an origin."""
    of_origin = {
        name: count_refinements(record for record in records if record.origin == origin)
        for origin, name in _ORIGINS.items()
    }
    counts = {name: counted for name, counted in of_origin.items() if counted.applied}
    columns = list(counts.values()) or [count_refinements(records)]
    rows = {
        "in all": [of.applied for of in columns],
        "return after > fitness before, as the thesis counts": [of.beyond_fitness for of in columns],
        "return after > return before, on the same unseen episodes": [of.beyond_return for of in columns],
        "return after < return before": [of.below_return for of in columns],
        "best of its generation": [of.new_best for of in columns],
        "written back into the population": [of.written_back for of in columns],
        "some parameter moved": [of.moved_parameters for of in columns],
        "some leaf changed its action": [of.changed_leaves for of in columns],
        "training broke off": [of.failed for of in columns],
    }
    head = (f"trees refined by {refiner}", *(counts or ("individuals",)))
    return Table.of(head, ((what, *(f"{n:,}" for n in numbers)) for what, numbers in rows.items()))


def _bridges(applied: Sequence[RefinementRecord]) -> Bridges | None:
    # A method without gradients measures hard trees alone, so none of its records has a soft return.
    is_soft = any(record.soft_return is not None for record in applied)
    rows = []
    for record in applied:
        soft = record.soft_return if is_soft else np.nan
        row = (record.return_before, soft, record.return_after, record.return_snapped)
        if None not in row:
            rows.append(row)
    if not rows:
        return None
    before, soft, after, snapped = np.array(rows, dtype=np.float64).mean(axis=0).tolist()
    return Bridges(len(rows), before, soft if is_soft else None, after, snapped)


def _bridges_line(bridges: Bridges) -> str:
    hardening = ""
    if bridges.soft is not None and bridges.lost_in_hardening is not None:
        hardening = (
            f"{bridges.lost_in_hardening:.2f} in hardening (soft {bridges.soft:.2f} -> {bridges.after:.2f}), "
        )
    return (
        f"* Mean loss of each bridge, of the {counted(bridges.applications, 'tree')} with all returns known: "
        f"{hardening}{bridges.lost_in_snapping:.2f} in snapping to the grammar's constants "
        f"({bridges.after:.2f} -> {bridges.snapped:.2f}). Before, they returned {bridges.before:.2f}."
    )


def _champions_line(runs: Sequence[Run], *, is_written_back: bool) -> str:
    origins = Counter(run.summary.champion_from for run in runs)
    polished = (
        f", and a polished one in {origins['polish']}" if any(run.summary.polished for run in runs) else ""
    )
    caveat = " A tree that was written back counts as one of the population." if is_written_back else ""
    return (
        f"* The champion is a refined tree in {origins['refinement']} of {counted(len(runs), 'run')}"
        f"{polished}.{caveat}"
    )


def _exceeds(after: float | None, before: float | None) -> bool:
    return after is not None and before is not None and after > before
