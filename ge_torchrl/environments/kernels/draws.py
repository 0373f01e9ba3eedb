"""NumPy's `default_rng(seed)` in compiled code: the same numbers, without an object a seed.

`SeedSequence` (O'Neill's `seed_seq_fe`, 2015) stretches a seed, PCG64 (O'Neill, 2014: XSL-RR, 128 bits of state)
draws; constants are those of NumPy's `_bit_generator.pyx` and `pcg64.h`. Tests hold both to NumPy bit for bit. Normal
numbers are made of these by a way of their own.
"""

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import compiled, inlined

_LOW_32 = np.uint64(0xFFFFFFFF)
_HALF = np.uint64(32)

_POOL_SIZE = 4
_XSHIFT = np.uint32(16)
_INIT_A, _MULT_A = np.uint32(0x43B0D7E5), np.uint32(0x931E8875)
_INIT_B, _MULT_B = np.uint32(0x8B51F9DD), np.uint32(0x58F38DED)
_MIX_LEFT, _MIX_RIGHT = np.uint32(0xCA01F9DD), np.uint32(0x4973F715)

_PCG_HIGH, _PCG_LOW = np.uint64(0x2360ED051FC65DA4), np.uint64(0x4385DF649FCCF645)
_TO_UNIT = 1.0 / 9007199254740992.0


@inlined
def _product(a: np.uint64, b: np.uint64) -> tuple[np.uint64, np.uint64]:
    """Return the upper and the lower 64 bits of a product."""
    a_high, a_low = a >> _HALF, a & _LOW_32
    b_high, b_low = b >> _HALF, b & _LOW_32
    low = a_low * b_low
    middle = a_high * b_low + (low >> _HALF)
    other = a_low * b_high + (middle & _LOW_32)
    return a_high * b_high + (middle >> _HALF) + (other >> _HALF), a * b


@inlined
def _step(state: NDArray[np.uint64]) -> None:
    """Multiply the state by PCG's constant and add the increment, modulo 2**128."""
    high, low = _product(state[1], _PCG_LOW)
    high += state[0] * _PCG_LOW + state[1] * _PCG_HIGH
    total = low + state[3]
    state[0] = high + state[2] + np.uint64(total < low)
    state[1] = total


@inlined
def draw_uniform(state: NDArray[np.uint64]) -> float:
    """Draw a number in [0, 1) as `Generator.random` does.

    Args:
        state: [4] uint64, a generator of `seed_generator`; it moves on.
    """
    _step(state)
    mixed = state[0] ^ state[1]
    turns = state[0] >> np.uint64(58)
    bits = (mixed >> turns) | (mixed << ((np.uint64(64) - turns) & np.uint64(63)))
    return np.float64(bits >> np.uint64(11)) * _TO_UNIT


@inlined
def draw_normal(state: NDArray[np.uint64]) -> float:
    """Draw a standard normal number: a ratio of uniforms, accepted within the bounds of Leva (1992, ACM TOMS 712).

    The logarithm only decides a draw in eighty, and is no part of a number: so the same bits come on any processor.

    Args:
        state: As `draw_uniform` takes it.
    """
    while True:
        # The uniform number stays above 0, whose logarithm would be needed.
        u = 1.0 - draw_uniform(state)
        v = 1.7156 * (draw_uniform(state) - 0.5)
        x = u - 0.449871
        y = abs(v) + 0.386595
        q = x * x + y * (0.19600 * y - 0.25472 * x)
        if q < 0.27597 or (q <= 0.27846 and v * v <= -4.0 * np.log(u) * (u * u)):
            return v / u


@inlined
def _finished(value: np.uint32, factor: np.uint32) -> np.uint32:
    value = np.uint32(value * factor)
    return np.uint32(value ^ (value >> _XSHIFT))


@compiled
def seed_generator(seed: int, state: NDArray[np.uint64]) -> None:
    """Set up the generator that `default_rng(seed)` is.

    Args:
        seed: At least 0.
        state: [4] uint64, written: upper and lower half of PCG64's state, then of its increment.
    """
    pool = np.zeros(_POOL_SIZE, np.uint32)
    pool[0], pool[1] = np.uint32(np.uint64(seed) & _LOW_32), np.uint32(np.uint64(seed) >> _HALF)
    constant = _INIT_A
    for i in range(_POOL_SIZE):
        value = np.uint32(pool[i] ^ constant)
        constant = np.uint32(constant * _MULT_A)
        pool[i] = _finished(value, constant)
    for source in range(_POOL_SIZE):
        for target in range(_POOL_SIZE):
            if source != target:
                value = np.uint32(pool[source] ^ constant)
                constant = np.uint32(constant * _MULT_A)
                value = _finished(value, constant)
                mixed = np.uint32(np.uint32(_MIX_LEFT * pool[target]) - np.uint32(_MIX_RIGHT * value))
                pool[target] = np.uint32(mixed ^ (mixed >> _XSHIFT))
    constant = _INIT_B
    words = np.zeros(2 * _POOL_SIZE, np.uint64)
    for i in range(2 * _POOL_SIZE):
        value = np.uint32(pool[i % _POOL_SIZE] ^ constant)
        constant = np.uint32(constant * _MULT_B)
        words[i] = np.uint64(_finished(value, constant))
    first_high, first_low = words[0] | (words[1] << _HALF), words[2] | (words[3] << _HALF)
    sequence_high, sequence_low = words[4] | (words[5] << _HALF), words[6] | (words[7] << _HALF)
    state[2] = (sequence_high << np.uint64(1)) | (sequence_low >> np.uint64(63))
    state[3] = (sequence_low << np.uint64(1)) | np.uint64(1)
    state[0], state[1] = np.uint64(0), np.uint64(0)
    _step(state)
    total = state[1] + first_low
    state[0] += first_high + np.uint64(total < first_low)
    state[1] = total
    _step(state)


@compiled
def first_uniforms(seeds: NDArray[np.int64], n: int) -> NDArray[np.float64]:
    """Return the first numbers that `default_rng(seed).random(n)` gives, for each seed.

    Args:
        seeds: [E] int64, at least 0.
        n: How many numbers of each.

    Returns:
        [E, n] float64 in [0, 1).
    """
    drawn = np.empty((len(seeds), n))
    state = np.empty(4, np.uint64)
    for e in range(len(seeds)):
        seed_generator(seeds[e], state)
        for i in range(n):
            drawn[e, i] = draw_uniform(state)
    return drawn
