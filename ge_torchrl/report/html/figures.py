"""Figures of a summary as a page shows them."""

from __future__ import annotations

import math
from statistics import NormalDist

from ge_torchrl.report.statistics import FEW, Interval

_Z = NormalDist().inv_cdf(0.975)


def number(value: float | None, decimals: int = 2) -> str:
    """Return a number with so many decimals and a true minus; an empty text for none."""
    return "" if value is None else f"{value:,.{decimals}f}".replace("-", "\u2212")


def mean_interval(mean: float, sd: float, n: int) -> Interval | None:
    """Return the 95 % interval of a mean of `n` episodes, by the normal approximation; None for a few.

    Args:
        mean: Of the returns.
        sd: Their standard deviation, with `n` in its denominator.
        n: Number of episodes.
    """
    if n < FEW:
        return None
    margin = _Z * sd / math.sqrt(n - 1)
    return Interval(mean - margin, mean + margin)


def seconds(value: float) -> str:
    """Return a time for a person: 11.5 s, 3 min 20 s, 2 h 5 min."""
    if value < 60:
        return f"{value:.1f} s"
    minutes, rest = divmod(round(value), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    return f"{minutes // 60} h {minutes % 60} min"


def short_count(value: int) -> str:
    """Return a large count in short: 276 million."""
    for size, name in ((10**9, "billion"), (10**6, "million")):
        if value >= size:
            return f"{value / size:.3g} {name}"
    return f"{value:,}"
