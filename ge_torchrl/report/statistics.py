"""How sure one can be of a few runs: intervals for means and rates."""

from __future__ import annotations

from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

FEW = 5
"""Fewer values than this say what they span and no more: a resample of three holds one of them alone too often."""
# Values of resamples that are in memory at a time: of thousands of runs all would take gigabytes.
_MOST_DRAWN = 2_000_000


class Interval(NamedTuple):
    """A confidence interval, or what few values span.

    Attributes:
        low: Lower end.
        high: Upper end.
    """

    low: float
    high: float


def spread_of(values: ArrayLike, rng: np.random.Generator, *, statistic: str = "mean") -> Interval:
    """Return the 95 % bootstrap interval of a mean or a median; of fewer than `FEW` values the least and the greatest.

    Args:
        values: [R] one value a run.
        rng: Draws the resamples.
        statistic: "mean" or "median".
    """
    observed = np.asarray(values, dtype=np.float64)
    if 0 < observed.size < FEW:
        return Interval(float(observed.min()), float(observed.max()))
    return bootstrap_interval(observed, rng, statistic=statistic)


def spread_band(curves: ArrayLike, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the same of the mean curve, point by point.

    Args:
        curves: [R, T] one curve a run.
        rng: Draws the resamples.

    Returns:
        [2, T] lower and upper end.
    """
    observed = np.asarray(curves, dtype=np.float64)
    if len(observed) < FEW:
        return np.stack([observed.min(axis=0), observed.max(axis=0)])
    return bootstrap_band(observed, rng)


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
    at_a_time = max(1, _MOST_DRAWN // observed.size)
    statistics = np.empty(n_resamples)
    for first in range(0, n_resamples, at_a_time):
        part = statistics[first : first + at_a_time]
        resamples = observed[rng.integers(observed.size, size=(len(part), observed.size))]
        part[:] = resamples.mean(axis=1) if statistic == "mean" else np.median(resamples, axis=1)
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


def mean_interval(mean: float, std: float, n: int, confidence: float = 0.95) -> Interval:
    """Return the interval of a mean over many values, by the normal distribution: `mean ± z std / sqrt(n)`.

    Args:
        mean: Mean of the values.
        std: Their standard deviation.
        n: Their number, at least 1: hundreds, as episodes of a test are.
        confidence: Share of such intervals that contain the truth, nearly.
    """
    margin = NormalDist().inv_cdf((1 + confidence) / 2) * std / n**0.5
    return Interval(mean - margin, mean + margin)


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


def _tails(confidence: float) -> list[float]:
    return [(1 - confidence) / 2, (1 + confidence) / 2]
