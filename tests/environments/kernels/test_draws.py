import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ge_torchrl.environments.kernels.draws import draw_normal, draw_uniform, first_uniforms, seed_generator


@given(st.lists(st.integers(0, 2**63 - 1) | st.integers(0, 2**31 - 1), max_size=8), st.integers(0, 9))
def test_first_numbers_are_numpys(seeds, n):
    drawn = first_uniforms(np.array(seeds, np.int64), n)
    expected = [np.random.default_rng(seed).random(n) for seed in seeds]
    np.testing.assert_array_equal(drawn, np.reshape(expected, (len(seeds), n)))


def test_a_generator_goes_on_as_numpys_does():
    state = np.empty(4, np.uint64)
    seed_generator(2024, state)
    rng = np.random.default_rng(2024)
    assert [draw_uniform(state) for _ in range(5000)] == rng.random(5000).tolist()


def test_normal_numbers_are_distributed_as_they_should_be():
    state = np.empty(4, np.uint64)
    seed_generator(7, state)
    drawn = np.sort([draw_normal(state) for _ in range(200_000)])
    n = len(drawn)
    # Standard errors of the first four moments of a normal number are 1, sqrt 2, sqrt 15 and sqrt 96, over sqrt n.
    for power, moment, deviation in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96)):
        assert abs((drawn**power).mean() - moment) < 4 * np.sqrt(deviation / n)
    below = np.array([0.5 * math.erfc(-x / math.sqrt(2)) for x in drawn])
    # Kolmogorov and Smirnov's distance is above 1.95 / sqrt n once in a thousand times.
    assert abs(below - (np.arange(n) + 0.5) / n).max() < 1.95 / np.sqrt(n)
    assert drawn[0] < -4
    assert drawn[-1] > 4
