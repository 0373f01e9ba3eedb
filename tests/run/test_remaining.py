import pytest
from hypothesis import given
from hypothesis import strategies as st
from records_for_tests import generation

from ge_torchrl.config import GEConfig
from ge_torchrl.run.remaining import Pace, duration, seconds_left


def record(number, elapsed, steps=1000):
    return generation(number, 1.0, steps=steps, elapsed_seconds=elapsed)


def after(number, elapsed, *, fraction=0.0, steps=1000, **limits):
    """Seconds left at two seconds and so many steps a generation."""
    pace = Pace(2.0, steps / 2.0)
    return seconds_left(record(number, elapsed, steps), pace, GEConfig(generations=10, **limits), fraction)


def test_generations_to_come_last_as_long_as_those_so_far():
    assert after(3, 8.0) == pytest.approx(12.0)
    assert after(9, 20.0) == 0.0


def test_what_follows_the_search_is_part_of_it():
    # A search of 20 s is four fifths of 25 s.
    assert after(3, 8.0, fraction=0.2) == pytest.approx(17.0)
    assert after(9, 20.0, fraction=0.2) == pytest.approx(5.0)


def test_no_more_than_the_limits_leave():
    assert after(3, 8.0, max_seconds=10.0) == pytest.approx(2.0)
    assert after(3, 8.0, max_env_steps=5000) == pytest.approx(2.0)
    assert after(3, 8.0, max_env_steps=1000) == 0.0
    assert after(3, 8.0, max_env_steps=1000, steps=0) == pytest.approx(12.0)


@given(st.integers(0, 9), st.floats(0, 1e6), st.floats(0, 0.99))
def test_it_is_never_negative(number, elapsed, fraction):
    assert after(number, elapsed, fraction=fraction) >= 0.0


def test_the_pace_leaves_out_what_came_before_the_first_generation():
    # Compiling took 100 s.
    first, last = record(0, 101.0), record(4, 105.0)
    assert Pace.between(first, last) == Pace(1.0, 1000.0)


def test_the_first_generation_tells_by_its_own_clock():
    # Its rollouts and its variation took half a second.
    only = record(0, 101.0)
    assert Pace.between(only, only) == Pace(0.5, 2000.0)


@pytest.mark.parametrize(
    ("seconds", "text"), [(None, "-"), (0.0, "0:00"), (59.6, "1:00"), (3725.0, "1:02:05")]
)
def test_durations(seconds, text):
    assert duration(seconds) == text
