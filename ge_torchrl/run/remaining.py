"""How fast a run goes on, and how much longer it takes."""

from __future__ import annotations

from dataclasses import dataclass

from ge_torchrl.artefacts.records import GenerationRecord
from ge_torchrl.config import Config, GEConfig

# Trees that were refined before converge early: so much of the last budget is spent.
_SPENT_AT_THE_END = 0.25
# The share of validation and test in a run without a last refinement.
_VALIDATION_AND_TEST = 0.05


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


def seconds_left(
    record: GenerationRecord, pace: Pace, config: GEConfig, fraction_after_search: float
) -> float:
    """Return the seconds that a run still takes after a generation, its limits held, as far as one can tell.

    Args:
        record: The generation.
        pace: Taken to be that of the generations to come.
        config: How many generations are planned, and the limits.
        fraction_after_search: Share of the whole run's time that everything after the last generation takes.
    """
    elapsed = record.elapsed_seconds
    search = elapsed + pace.seconds_per_generation * (config.generations - record.generation - 1)
    left = search / (1 - fraction_after_search) - elapsed
    if config.max_seconds is not None:
        left = min(left, config.max_seconds - elapsed)
    if config.max_env_steps and pace.steps_per_second > 0:
        left = min(left, (config.max_env_steps - record.env_steps) / pace.steps_per_second)
    return max(0.0, left)


def duration(seconds: float | None) -> str:
    """Return seconds as minutes and seconds, with hours where there are any; a dash where nobody knows."""
    if seconds is None:
        return "-"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


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
