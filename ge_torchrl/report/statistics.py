"""How sure one can be of a few runs: intervals for means and rates, and ratios of what solving took."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ge_torchrl.records import GenerationRecord


class Interval(NamedTuple):
    """A confidence interval.

    Attributes:
        low: Lower end.
        high: Upper end.
    """

    low: float
    high: float


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


def bootstrap_interval(
    values: ArrayLike,
    rng: np.random.Generator,
    *,
    statistic: str = "mean",
    confidence: float = 0.95,
    n_resamples: int = 10_000,
) -> Interval:
    """Return the percentile bootstrap interval of a mean or a median.

    With `s*_1 ... s*_B` the statistic of `B` resamples drawn with replacement, the interval is
    `[q((1 - c) / 2), q((1 + c) / 2)]` of their quantiles `q`. A single value gives an interval of no width.
    Source: Efron and Tibshirani, "An Introduction to the Bootstrap" (1993), section 13.3.

    Args:
        values: [R] one value a run.
        rng: Draws the resamples.
        statistic: "mean" or "median".
        confidence: Share `c` of such intervals that contain the truth, nearly.
        n_resamples: Their number `B`.

    Raises:
        ValueError: There is no value, or the statistic is another one.
    """
    observed = np.asarray(values, dtype=np.float64)
    if observed.ndim != 1 or not observed.size:
        raise ValueError(f"expected a vector of at least one value; got shape {observed.shape}")
    if statistic not in ("mean", "median"):
        raise ValueError(f"statistic must be mean or median; got {statistic}")
    resamples = observed[rng.integers(observed.size, size=(n_resamples, observed.size))]
    statistics = resamples.mean(axis=1) if statistic == "mean" else np.median(resamples, axis=1)
    low, high = np.quantile(statistics, _tails(confidence))
    return Interval(float(low), float(high))


def bootstrap_band(
    curves: ArrayLike, rng: np.random.Generator, *, confidence: float = 0.95, n_resamples: int = 2000
) -> NDArray[np.float64]:
    """Return the percentile bootstrap interval of the mean curve, point by point, whole curves resampled.

    Args:
        curves: [R, T] one curve a run.
        rng: Draws the resamples.
        confidence: As of `bootstrap_interval`.
        n_resamples: Likewise.

    Returns:
        [2, T] lower and upper end.
    """
    observed = np.asarray(curves, dtype=np.float64)
    runs = len(observed)
    # How often each curve is drawn is all that a mean needs of a resample.
    drawn = rng.multinomial(runs, np.full(runs, 1 / runs), size=n_resamples)
    band: NDArray[np.float64] = np.quantile(drawn @ observed / runs, _tails(confidence), axis=0)
    return band


def wilson_interval(successes: int, n: int, confidence: float = 0.95) -> Interval:
    """Return Wilson's interval of a rate, which is sound for few trials and for rates of 0 and 1.

    With `p = successes / n` and the normal quantile `z` it is
    `(p + z^2 / 2n ± z sqrt(p (1 - p) / n + z^2 / 4n^2)) / (1 + z^2 / n)`.
    Source: Wilson, "Probable inference, the law of succession, and statistical inference" (1927).

    Args:
        successes: Trials that succeeded.
        n: Trials.
        confidence: Share of such intervals that contain the truth, nearly.

    Raises:
        ValueError: There is no trial, or successes are not between 0 and `n`.
    """
    if not 0 <= successes <= n or n == 0:
        raise ValueError(f"expected 0 <= successes <= n with n > 0; got {successes} of {n}")
    z = NormalDist().inv_cdf((1 + confidence) / 2)
    rate = successes / n
    centre = rate + z**2 / (2 * n)
    margin = z * np.sqrt(rate * (1 - rate) / n + z**2 / (4 * n**2))
    scale = 1 + z**2 / n
    # At the rates 0 and 1 rounding must not exclude the rate itself.
    return Interval(
        low=0.0 if successes == 0 else float((centre - margin) / scale),
        high=1.0 if successes == n else float((centre + margin) / scale),
    )


def best_of(record: GenerationRecord) -> float | None:
    """Return the best fitness of a generation, refined trees included; None where there is no tree."""
    measured = [value for value in (record.best_fitness, record.best_refined) if value is not None]
    return max(measured, default=None)


def generations_to_solve(history: Sequence[GenerationRecord], threshold: float) -> int | None:
    """Return the first generation whose best fitness, refined trees included, reaches the threshold.

    Args:
        history: Generations in their order.
        threshold: Mean return from which the task counts as solved.

    Returns:
        The number of the generation, 0 for the first population; None where no generation does.
    """
    for record in history:
        best = best_of(record)
        if best is not None and best >= threshold:
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
    confidence: float = 0.95,
    n_resamples: int = 10_000,
) -> PairedRatio:
    """Return the median over pairs of `measure(treated) / measure(control)`, with its interval.

    A censored run counts as all that it took, a lower bound of what it would have needed.

    Args:
        pairs: [R] a treated run and its control, of one seed each.
        rng: Resamples the pairs.
        measure: What counts: `generations_of` or `env_steps_of`.
        confidence: As of `bootstrap_interval`.
        n_resamples: Likewise.

    Raises:
        ValueError: There is no pair.
    """
    ratios = [measure(treated) / measure(control) for treated, control in pairs]
    interval = bootstrap_interval(
        ratios, rng, statistic="median", confidence=confidence, n_resamples=n_resamples
    )
    return PairedRatio(
        median=float(np.median(ratios)),
        interval=interval,
        pairs=len(pairs),
        treated_censored=sum(treated.censored for treated, _ in pairs),
        control_censored=sum(control.censored for _, control in pairs),
        both_censored=sum(treated.censored and control.censored for treated, control in pairs),
    )


def _tails(confidence: float) -> list[float]:
    return [(1 - confidence) / 2, (1 + confidence) / 2]
