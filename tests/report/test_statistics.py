import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ge_torchrl.report import statistics
from ge_torchrl.report.statistics import (
    bootstrap_band,
    bootstrap_interval,
    spread_band,
    spread_of,
    wilson_interval,
)


@pytest.mark.parametrize(
    ("successes", "n", "low", "high"),
    [
        (9, 10, 0.5958, 0.9821),
        (5, 10, 0.2366, 0.7634),
        (10, 10, 0.7225, 1.0),
        (0, 10, 0.0, 0.2775),
        (29, 40, 0.5717, 0.8389),
        (1, 1, 0.2065, 1.0),
    ],
)
def test_wilson_intervals_typed_by_hand(successes, n, low, high):
    assert wilson_interval(successes, n) == pytest.approx((low, high), abs=5e-5)


def test_wilson_interval_of_less_confidence_is_narrower():
    assert wilson_interval(9, 10, confidence=0.9) == pytest.approx((0.6523, 0.9774), abs=5e-5)


@given(st.integers(1, 200), st.data())
def test_wilson_interval_holds_the_rate_and_mirrors(n, data):
    successes = data.draw(st.integers(0, n))
    low, high = wilson_interval(successes, n)
    assert 0 <= low <= successes / n <= high <= 1
    assert wilson_interval(n - successes, n) == pytest.approx((1 - high, 1 - low))


@pytest.mark.parametrize(("successes", "n"), [(0, 0), (-1, 3), (4, 3)])
def test_wilson_interval_refuses_what_is_no_rate(successes, n):
    with pytest.raises(ValueError, match="0 <= successes <= n"):
        wilson_interval(successes, n)


def test_bootstrap_of_two_values_is_their_range():
    # A quarter of the resamples holds one value alone, more than either tail.
    assert bootstrap_interval([2.0, 6.0], np.random.default_rng(0)) == (2.0, 6.0)


def test_bootstrap_of_the_mean_agrees_with_theory():
    values = np.random.default_rng(1).normal(10.0, 2.0, size=400)
    low, high = bootstrap_interval(values, np.random.default_rng(0))
    margin = 1.96 * values.std() / 20
    assert low == pytest.approx(values.mean() - margin, abs=0.02)
    assert high == pytest.approx(values.mean() + margin, abs=0.02)


def test_bootstrap_of_the_median_ignores_what_the_mean_does_not():
    values = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1000.0]
    rng = np.random.default_rng(0)
    assert bootstrap_interval(values, rng, statistic="median") == (1.0, 1.0)
    assert bootstrap_interval(values, rng).high > 100


def test_bootstrap_of_one_value_has_no_width():
    assert bootstrap_interval([3.5], np.random.default_rng(0)) == (3.5, 3.5)


def test_bootstrap_is_a_function_of_its_generator():
    values = np.arange(10.0) ** 2
    first, again, other = (bootstrap_interval(values, np.random.default_rng(seed)) for seed in (7, 7, 8))
    assert first == again != other


@pytest.mark.parametrize(("values", "statistic"), [([], "mean"), ([[1.0]], "mean"), ([1.0], "mode")])
def test_bootstrap_refuses_what_it_cannot_do(values, statistic):
    with pytest.raises(ValueError, match=r"expected a vector|must be mean or median"):
        bootstrap_interval(values, np.random.default_rng(0), statistic=statistic)


def test_band_agrees_with_the_interval_of_each_point():
    curves = np.random.default_rng(2).normal(size=(10, 3)).cumsum(axis=1)
    band = bootstrap_band(curves, np.random.default_rng(0), n_resamples=20_000)
    assert band.shape == (2, 3)
    for point in range(3):
        interval = bootstrap_interval(curves[:, point], np.random.default_rng(1), n_resamples=20_000)
        assert band[:, point] == pytest.approx(interval, abs=0.03)


@pytest.mark.parametrize("statistic", ["mean", "median"])
def test_intervals_of_thousands_of_runs_are_drawn_in_parts_to_the_same_bits(monkeypatch, statistic):
    values = np.random.default_rng(1).normal(size=37)

    def found(most_drawn):
        monkeypatch.setattr(statistics, "_MOST_DRAWN", most_drawn)
        rng = np.random.default_rng(2)
        return bootstrap_interval(values, rng, statistic=statistic, n_resamples=501), rng.random()

    assert found(10**9) == found(37 * 100 + 5) == found(1)


@pytest.mark.parametrize("n", [1, 2, 4])
def test_few_values_are_told_as_what_they_span(n):
    values = [1.0, 1.0, 1.0, 9.0][-n:]
    assert spread_of(values, np.random.default_rng(0)) == (min(values), max(values))
    band = spread_band([[value, 2 * value] for value in values], np.random.default_rng(0))
    assert band.tolist() == [[min(values), 2 * min(values)], [max(values), 2 * max(values)]]


def test_enough_values_have_an_interval():
    values, rngs = [1.0, 1.0, 1.0, 1.0, 9.0], [np.random.default_rng(0) for _ in range(4)]
    assert spread_of(values, rngs[0]) == bootstrap_interval(values, rngs[1])
    curves = [[value] for value in values]
    assert (spread_band(curves, rngs[2]) == bootstrap_band(curves, rngs[3])).all()
    assert spread_of(values, rngs[0]).high < 9.0
