import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ge_torchrl.environments.draws import draw_uniform, first_uniforms, seed_generator


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
