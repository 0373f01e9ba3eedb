"""What refinement did to trees: its applications counted, and what was lost on the way."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ge_torchrl.records import RefinementRecord


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
        new_best: Those that became the best of their generation.
        written_back: Those that, snapped to the grammar's constants, took their source's place in the population.
        moved_thresholds: Those that changed a threshold.
        changed_leaves: Those that changed a leaf's action.
        failed: Those whose training broke off.
        skipped: Times that no candidate was found; they are not in `applied`.
        timesteps: Environment steps sampled.
        bridges: What was lost on the way; None where no refined tree was snapped.
    """

    applied: int
    beyond_fitness: int
    beyond_return: int
    new_best: int
    written_back: int
    moved_thresholds: int
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
        new_best=sum(record.new_best for record in applied),
        written_back=sum(record.written_back for record in applied),
        moved_thresholds=sum(bool(record.thresholds_moved) for record in applied),
        changed_leaves=sum(bool(record.leaves_changed) for record in applied),
        failed=sum(record.outcome == "failed" for record in applied),
        skipped=len(every) - len(applied),
        timesteps=sum(record.timesteps or 0 for record in applied),
        bridges=_bridges(applied),
    )


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


def _exceeds(after: float | None, before: float | None) -> bool:
    return after is not None and before is not None and after > before
