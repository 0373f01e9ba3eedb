"""What PPO did to trees: its applications counted."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ge_torchrl.records import RefinementRecord


@dataclass(frozen=True)
class RefinementCounts:
    """Applications of PPO, of one run or of many.

    Attributes:
        applied: Trees that PPO was applied to, failures included.
        beyond_fitness: Those whose return after exceeds the fitness before, as the thesis counts. The one is
            measured on many unseen episodes, the other on the few training episodes.
        beyond_return: Those whose return after exceeds the return before, on the same unseen episodes.
        new_best: Those that became the best of their generation.
        moved_thresholds: Those that changed a threshold.
        changed_leaves: Those that changed a leaf's action.
        failed: Those whose training broke off.
        skipped: Generations in which no candidate was found; they are not in `applied`.
        timesteps: Environment steps sampled.
    """

    applied: int
    beyond_fitness: int
    beyond_return: int
    new_best: int
    moved_thresholds: int
    changed_leaves: int
    failed: int
    skipped: int
    timesteps: int


def count_refinements(records: Iterable[RefinementRecord]) -> RefinementCounts:
    """Count applications of PPO.

    Args:
        records: Of one run or of many.
    """
    every = list(records)
    applied = [record for record in every if record.outcome != "skipped"]
    return RefinementCounts(
        applied=len(applied),
        beyond_fitness=sum(_exceeds(record.return_after, record.fitness_before) for record in applied),
        beyond_return=sum(_exceeds(record.return_after, record.return_before) for record in applied),
        new_best=sum(record.new_best for record in applied),
        moved_thresholds=sum(bool(record.thresholds_moved) for record in applied),
        changed_leaves=sum(bool(record.leaves_changed) for record in applied),
        failed=sum(record.outcome == "failed" for record in applied),
        skipped=len(every) - len(applied),
        timesteps=sum(record.timesteps or 0 for record in applied),
    )


def _exceeds(after: float | None, before: float | None) -> bool:
    return after is not None and before is not None and after > before
