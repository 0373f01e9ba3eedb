"""Numbers of trees as texts from which other languages read the same number."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np


def float32_text(number: float) -> str:
    """Return the shortest decimal that rounds to a float32, with a point: `0.0154`, `1.0e-45`."""
    return _with_point(str(np.float32(number)))


def float64_text(number: float) -> str:
    """Return the shortest decimal that rounds to the float64 which equals a float32: `0.015399999916553497`."""
    return _with_point(repr(float(number)))


def sum_text(terms: Iterable[tuple[float, str]], constant: float | None = None, typed: str = "") -> str:
    """Return a sum in the order of its terms, which float64 adds from left to right: `0.5 - 2.0 * x`.

    Args:
        terms: Weights, and what they weigh.
        constant: Stands in front, if there is one.
        typed: What a language writes in front of a float64, such as `LREAL#`.
    """
    text = "" if constant is None else typed + float64_text(constant)
    for weight, name in terms:
        size = abs(weight)
        product = name if size == 1 else f"{typed}{float64_text(size)} * {name}"
        is_negative = np.signbit(weight)
        if text:
            text += f" - {product}" if is_negative else f" + {product}"
        else:
            text = f"-{product}" if is_negative else product
    return text


def _with_point(text: str) -> str:
    mantissa, e, exponent = text.partition("e")
    return f"{mantissa if '.' in mantissa else mantissa + '.0'}{e}{exponent}"
