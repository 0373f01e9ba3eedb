"""When a run solved its task, and what that took over what it took another run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ge_torchrl.artefacts.records import GenerationRecord
from ge_torchrl.report.statistics import Interval, spread_of


@dataclass(frozen=True)
class SolvingTime:
    """When a run's best fitness first reached the threshold.

    Attributes:
        generation: Number of that generation, 0 for the first population; None where none did (censored).
        generations_run: Generations that the run lasted, the first population included.
        env_steps: Environment steps up to the end of that generation, refinements and exploring included; of a
            censored run all its steps, a lower bound.
    """

    generation: int | None
    generations_run: int
    env_steps: int

    @property
    def censored(self) -> bool:
        """Whether the run ended before it reached the threshold."""
        return self.generation is None

    @property
    def generations(self) -> int:
        """Generations that were needed, the first population included; of a censored run a lower bound."""
        return self.generations_run if self.generation is None else self.generation + 1


@dataclass(frozen=True)
class PairedRatio:
    """What treated runs took to reach the threshold over what their controls took.

    Attributes:
        median: Median of the ratios; below 1 the treatment takes less.
        interval: Bootstrap interval of the median over pairs.
        pairs: Number of pairs.
        treated_censored: Treated runs that never reached the threshold; their ratios are too small.
        control_censored: Controls that never did; their ratios are too large.
        both_censored: Pairs counted in both; they tell nothing, and their ratio is that of the runs' lengths.
    """

    median: float
    interval: Interval
    pairs: int
    treated_censored: int
    control_censored: int
    both_censored: int


def generations_to_solve(history: Sequence[GenerationRecord], threshold: float) -> int | None:
    """Return the first generation whose best fitness, refined trees included, reaches the threshold.

    Args:
        history: Generations in their order.
        threshold: Mean return from which the task counts as solved.

    Returns:
        The number of the generation, 0 for the first population; None where no generation does.
    """
    for record in history:
        if record.best is not None and record.best >= threshold:
            return record.generation
    return None


def solving_time(history: Sequence[GenerationRecord], threshold: float) -> SolvingTime:
    """Return when a run reached the threshold, and how long it had to do so.

    Args:
        history: Generations in their order, at least one.
        threshold: Mean return from which the task counts as solved.
    """
    solved_in = generations_to_solve(history, threshold)
    last = next((record for record in history if record.generation == solved_in), history[-1])
    return SolvingTime(solved_in, len(history), last.env_steps)


def generations_of(time: SolvingTime) -> int:
    """Return the generations that a run took to reach the threshold."""
    return time.generations


def env_steps_of(time: SolvingTime) -> int:
    """Return the environment steps that a run took to reach the threshold."""
    return time.env_steps


def paired_ratio(
    pairs: Sequence[tuple[SolvingTime, SolvingTime]],
    rng: np.random.Generator,
    *,
    measure: Callable[[SolvingTime], int] = generations_of,
) -> PairedRatio:
    """Return the median over pairs of `measure(treated) / measure(control)`, with its interval.

    A censored run counts as all that it took, a lower bound of what it would have needed.

    Args:
        pairs: [R] a treated run and its control, of one seed each.
        rng: Resamples the pairs.
        measure: What counts: `generations_of` or `env_steps_of`.

    Raises:
        ValueError: There is no pair.
    """
    ratios = [measure(treated) / measure(control) for treated, control in pairs]
    interval = spread_of(ratios, rng, statistic="median")
    return PairedRatio(
        median=float(np.median(ratios)),
        interval=interval,
        pairs=len(pairs),
        treated_censored=sum(treated.censored for treated, _ in pairs),
        control_censored=sum(control.censored for _, control in pairs),
        both_censored=sum(treated.censored and control.censored for treated, control in pairs),
    )
