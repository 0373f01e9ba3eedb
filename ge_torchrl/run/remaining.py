"""How fast a run goes on, and how much longer it takes."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Collection
from dataclasses import dataclass

from ge_torchrl.artefacts.records import GenerationRecord
from ge_torchrl.config import Config
from ge_torchrl.run.costs import NOTHING, Cost

# Trees that were refined before converge early: so much of the last budget is spent.
_SPENT_AT_THE_END = 0.25
# The share of validation and test in a run without a last refinement.
_VALIDATION_AND_TEST = 0.05
# Generations of a kind that tell of those to come: the longer trees live, the longer they take.
_LATEST = 4


@dataclass(frozen=True)
class Pace:
    """How fast a search goes on, what came before its first generation left out: compiling, importing, measuring.

    Attributes:
        seconds_per_generation: Mean clock time of a generation.
        steps_per_second: Environment steps a second.
    """

    seconds_per_generation: float
    steps_per_second: float

    @classmethod
    def between(cls, first: GenerationRecord, last: GenerationRecord) -> Pace:
        """Return the pace from the end of one generation to the end of another.

        Args:
            first: A generation of the run; with no other yet it tells by its own clock.
            last: The last one.
        """
        generations = last.generation - first.generation
        if generations == 0:
            seconds = last.evaluation_seconds + last.variation_seconds
            return cls(seconds / (last.generation + 1), last.env_steps / max(seconds, 1e-9))
        seconds = last.elapsed_seconds - first.elapsed_seconds
        return cls(seconds / generations, (last.env_steps - first.env_steps) / max(seconds, 1e-9))


class Estimate:
    """How much longer a run takes, its limits held, as far as one can tell from the generations so far.

    Generations with a refinement count by themselves: where steps are dear they take far longer than others. Before the
    first of them a guess stands in for it.

    Args:
        config: The configuration, its budgets resolved.
        fraction_after_search: Share of the whole run's time that everything after the last generation takes.
        refinement: Guess of what a generation's refinement takes.
    """

    def __init__(
        self, config: Config, fraction_after_search: float = 0.0, refinement: Cost = NOTHING
    ) -> None:
        self._config, self._fraction, self._refinement = config, fraction_after_search, refinement
        self._due = [g for g in range(config.ge.generations) if self._is_refined(g)]
        self._last: GenerationRecord | None = None
        self._first = NOTHING
        self._plain: deque[Cost] = deque(maxlen=_LATEST)
        self._refined: deque[Cost] = deque(maxlen=_LATEST)

    def seconds_left(self, record: GenerationRecord) -> float:
        """Take notice of one more generation, and return the seconds left after it."""
        self._notice(record)
        plain = _mean(self._plain) if self._plain else self._first
        refined = _mean(self._refined) if self._refined else plain + self._refinement
        ge, elapsed = self._config.ge, record.elapsed_seconds
        n_refined = len(self._due) - bisect_right(self._due, record.generation)
        n_plain = ge.generations - record.generation - 1 - n_refined
        search = plain.times(n_plain) + refined.times(n_refined)
        if ge.max_env_steps and search.steps > 0:
            # Limits end the search so early that the rest has its part.
            most = (1 - self._fraction) * ge.max_env_steps - record.env_steps
            search = search.times(max(0.0, min(1.0, most / search.steps)))
        left = (elapsed + search.seconds) / (1 - self._fraction) - elapsed
        return max(0.0, left if ge.max_seconds is None else min(left, ge.max_seconds - elapsed))

    def _notice(self, record: GenerationRecord) -> None:
        last, self._last = self._last, record
        if last is None:
            # What came before it is left out: compiling, importing, measuring.
            self._first = Cost(record.evaluation_seconds + record.variation_seconds, record.env_steps)
        elif record.generation > last.generation:
            took = Cost(
                record.elapsed_seconds - last.elapsed_seconds, record.env_steps - last.env_steps
            ).times(1 / (record.generation - last.generation))
            (self._refined if self._is_refined(record.generation) else self._plain).append(took)

    def _is_refined(self, generation: int) -> bool:
        refiner = self._config.refiner
        return refiner.enabled and refiner.schedule.applies_to(generation)


def _mean(costs: Collection[Cost]) -> Cost:
    return sum(costs, NOTHING).times(1 / len(costs))


def duration(seconds: float | None) -> str:
    """Return seconds as minutes and seconds, with hours where there are any; a dash where nobody knows."""
    if seconds is None:
        return "-"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def rate(per_second: float) -> str:
    """Return how many a second, in thousands or millions where it is as many: `30.6 k`."""
    for unit, size in (("M", 1e6), ("k", 1e3)):
        if per_second >= size:
            return f"{per_second / size:.1f} {unit}"
    return f"{per_second:.0f}"


def fraction_after_search(config: Config) -> float:
    """Return the share of a run's time that everything after the last generation takes, as its budgets tell.

    Args:
        config: The configuration, its budgets resolved.
    """
    archive, polish, schedule = config.archive, config.polish, config.refiner.schedule
    proposals = config.refiner.candidates + archive.neighbours + archive.revisit_factor
    due = [g for g in range(config.ge.generations) if polish.applies_to(g) or schedule.applies_to(g)]
    last = archive.final_keep * archive.max_nodes * archive.final_factor * archive.final_patience
    last_share = _SPENT_AT_THE_END * last
    return last_share / max(last_share + proposals * len(due), 1) if last else _VALIDATION_AND_TEST
