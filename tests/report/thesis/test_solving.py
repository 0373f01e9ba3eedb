import numpy as np
import pytest
from records_for_tests import history

from ge_torchrl.report.thesis.solving import (
    SolvingTime,
    env_steps_of,
    generations_to_solve,
    paired_ratio,
    solving_time,
)


def test_generations_to_solve():
    assert generations_to_solve(history([9.0, 474.9, 475.0, 500.0]), 475.0) == 2
    assert generations_to_solve(history([500.0]), 475.0) == 0
    assert generations_to_solve(history([9.0, 9.0]), 475.0) is None
    assert generations_to_solve(history([None, None, 9.0], [None, 499.8]), 475.0) == 1


def test_solving_time_counts_the_first_population():
    assert solving_time(history([9.0, 500.0, 500.0]), 475.0) == SolvingTime(1, 3, 2000)
    assert solving_time(history([9.0, 500.0]), 475.0).generations == 2
    censored = solving_time(history([9.0, 400.0, 470.0]), 475.0)
    assert (censored.generation, censored.generations, censored.censored) == (None, 3, True)
    assert censored.env_steps == 3000


def test_ratio_of_run_4_of_the_thesis():
    # It solved CartPole in generation 40 with PPO and in 128 without.
    ratio = paired_ratio(
        [(SolvingTime(40, 200, 9000), SolvingTime(128, 200, 6000))], np.random.default_rng(0)
    )
    assert ratio.median == pytest.approx(41 / 129)
    assert ratio.interval == pytest.approx((41 / 129, 41 / 129))
    assert (ratio.pairs, ratio.treated_censored, ratio.control_censored, ratio.both_censored) == (1, 0, 0, 0)


def test_ratio_of_environment_steps():
    # Fewer generations may take more steps.
    pairs = [
        (SolvingTime(4, 10, 30), SolvingTime(9, 10, 10)),
        (SolvingTime(0, 10, 10), SolvingTime(9, 10, 10)),
    ]
    ratio = paired_ratio(pairs, np.random.default_rng(0), measure=env_steps_of)
    assert (ratio.median, ratio.interval) == (2.0, (1.0, 3.0))
    assert paired_ratio(pairs, np.random.default_rng(0)).median == pytest.approx(0.3)


def test_ratio_of_pairs_takes_the_median_and_counts_the_censored():
    pairs = [
        (SolvingTime(9, 100, 1), SolvingTime(19, 100, 1)),  # 10 / 20
        (SolvingTime(9, 100, 1), SolvingTime(None, 100, 1)),  # 10 / 100, too large
        (SolvingTime(None, 100, 1), SolvingTime(49, 100, 1)),  # 100 / 50, too small
        (SolvingTime(None, 100, 1), SolvingTime(None, 100, 1)),  # tells nothing
        (SolvingTime(0, 100, 1), SolvingTime(3, 100, 1)),  # 1 / 4
    ]
    ratio = paired_ratio(pairs, np.random.default_rng(0))
    assert ratio.median == 0.5
    assert 0.1 <= ratio.interval.low < 0.5 < ratio.interval.high <= 2.0
    assert (ratio.pairs, ratio.treated_censored, ratio.control_censored, ratio.both_censored) == (5, 2, 2, 1)


def test_ratio_needs_a_pair():
    with pytest.raises(ValueError, match="at least one"):
        paired_ratio([], np.random.default_rng(0))
