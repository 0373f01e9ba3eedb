"""Sine and cosine without branches, so that LLVM can compute many lanes at once.

Both follow fdlibm (Sun Microsystems, 1993, `k_sin.c` and `k_cos.c`): range reduction to [-pi/4, pi/4], then minimax
polynomials; the error stays below one unit in the last place for the angles of classic control (|x| < 1e5 rad).
"""

import numpy as np

from ge_torchrl.compilation import compiled

_ROUNDER = 6755399441055744.0
_TWO_OVER_PI = 6.36619772367581382433e-01
# pi / 2 in two parts; the first has 33 bits, so that its product with a small integer is exact.
_HALF_PI_HIGH = 1.57079632673412561417e00
_HALF_PI_LOW = 6.07710050650619224932e-11

_S1 = -1.66666666666666324348e-01
_S2 = 8.33333333332248946124e-03
_S3 = -1.98412698298579493134e-04
_S4 = 2.75573137070700676789e-06
_S5 = -2.50507602534068634195e-08
_S6 = 1.58969099521155010221e-10

_C1 = 4.16666666666666019037e-02
_C2 = -1.38888888888741095749e-03
_C3 = 2.48015872894767294178e-05
_C4 = -2.75573143513906633035e-07
_C5 = 2.08757232129817482790e-09
_C6 = -1.13596475577881948265e-11


@compiled
def round_to_integer(x: float) -> float:
    """Round to the nearest integer, |x| < 2**51: adding 1.5 * 2**52 leaves no room for a fraction."""
    return (x + _ROUNDER) - _ROUNDER


@compiled
def sin_cos_reduced(r: float) -> tuple[float, float]:
    """Return sine and cosine of an angle within [-pi/4, pi/4] rad."""
    z = r * r
    sine = r + r * z * (_S1 + z * (_S2 + z * (_S3 + z * (_S4 + z * (_S5 + z * _S6)))))
    half = 0.5 * z
    rest = 1.0 - half
    tail = z * z * (_C1 + z * (_C2 + z * (_C3 + z * (_C4 + z * (_C5 + z * _C6)))))
    cosine = rest + (((1.0 - rest) - half) + tail)
    return sine, cosine


@compiled
def sin_cos(x: float) -> tuple[float, float]:
    """Return sine and cosine of any angle of moderate size [rad]."""
    quarter_turns = round_to_integer(x * _TWO_OVER_PI)
    s, c = sin_cos_reduced((x - quarter_turns * _HALF_PI_HIGH) - quarter_turns * _HALF_PI_LOW)
    quadrant = np.int32(quarter_turns)
    swapped = (quadrant & 1) != 0
    sine = c if swapped else s
    cosine = s if swapped else c
    sine = -sine if (quadrant & 2) != 0 else sine
    cosine = -cosine if ((quadrant + 1) & 2) != 0 else cosine
    return sine, cosine
