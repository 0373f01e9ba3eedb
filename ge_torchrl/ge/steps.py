"""Constants that a person can read: nice steps, and ranges that are written with all their digits."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Final

# Steps are 1, 2 or 5 times a power of ten. A range is cut into at least that many, and into at most 2.5 times as many.
LEAST_STEPS: Final = 400
# No step is finer than what float32 keeps of a range's ends, nor than what the notation can write.
FLOAT32: Final = 2.0**-23
FINEST_STEP: Final = Fraction(1, 10**12)


def nice(number: float, at_least: float = 0.0) -> Fraction:
    """Return the largest of 1, 2 or 5 times a power of ten that is not above a number; 0 for none.

    Args:
        number: The number.
        at_least: Instead of smaller ones, the smallest that is not below this is taken.
    """
    if number <= 0:
        return Fraction(0)
    exponent = math.floor(math.log10(max(number, at_least)))
    steps = [
        digit * Fraction(10) ** power for power in range(exponent - 1, exponent + 2) for digit in (1, 2, 5)
    ]
    if number >= at_least:
        return max(step for step in steps if step <= Fraction(number))
    return min(step for step in steps if step >= Fraction(at_least))


def _step_between(low: float, high: float) -> Fraction:
    return nice((high - low) / LEAST_STEPS, at_least=max(abs(low), abs(high)) * FLOAT32)


def has_room(low: float, high: float) -> bool:
    """Tell whether there is more than one number between bounds that can be written."""
    step = _step_between(low, high)
    return step >= FINEST_STEP and high - low > step


def inner_range(low: float, high: float) -> str:
    """Return the constants between the bounds of an action, or its middle where there is no room for any."""
    step = _step_between(low, high)
    if not has_room(low, high):
        return decimal(Fraction(round(_exact((low + high) / 2) / FINEST_STEP)) * FINEST_STEP)
    first, last = math.ceil(_exact(low) / step), math.floor(_exact(high) / step)
    return f"[{decimal(first * step)}, {decimal(last * step)}] step {decimal(step)}"


def range_text(low: float, high: float, step: Fraction) -> str:
    """Return constants from a multiple of ten steps at or below `low` to one at or above `high`."""
    tens = 10 * step
    first, last = math.floor(_exact(low) / tens), math.ceil(_exact(high) / tens)
    return f"[{decimal(first * tens)}, {decimal(last * tens)}] step {decimal(step)}"


def _exact(number: float) -> Fraction:
    """Return the decimal that a float32 stands for: 0.1 is a tenth."""
    return Fraction(f"{number:.7g}")


def decimal(number: Fraction) -> str:
    """Return a number that is a multiple of a power of ten, all its digits."""
    decimals = 0
    while (number * 10**decimals).denominator > 1:
        decimals += 1
    digits = f"{abs(int(number * 10**decimals)):0{decimals + 1}d}"
    whole, rest = digits[: len(digits) - decimals], digits[len(digits) - decimals :]
    return ("-" if number < 0 else "") + whole + (f".{rest}" if rest else "")
