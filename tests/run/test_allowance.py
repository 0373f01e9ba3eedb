import math

import pytest
from problems_for_tests import config_of

from ge_torchrl.run.allowance import Allowance, Phase

MANY = {"episodes": 3, "validation_episodes": 10**6, "test_episodes": 10**6, "steps_per_second": 1e8}
KEEPING = {"keep": 3, "final_keep": 1}


def allowance(ge, started=0.0, archive=None, evaluation=None):
    config = config_of(ge=ge, archive=archive or KEEPING, evaluation=evaluation or MANY)
    return Allowance.of(config, started, max_episode_steps=500)


def test_without_limits_a_run_may_take_what_it_takes():
    assert [allowance({}, 100.0).until(phase) for phase in Phase] == [None] * len(Phase)
    assert [allowance({"max_env_steps": 0}, 100.0).until(phase) for phase in Phase] == [None] * len(Phase)


@pytest.mark.parametrize(
    ("phase", "share"),
    [(Phase.SEARCH, 0.7), (Phase.FINAL_REFINEMENT, 0.8), (Phase.VALIDATION, 0.9), (Phase.RECORD, 1.0)],
)
def test_each_phase_ends_so_that_the_next_has_its_part(phase, share):
    seconds = allowance({"max_seconds": 60}, 100.0).until(phase)
    assert (seconds.deadline, seconds.max_env_steps) == (pytest.approx(100 + share * 60), None)
    steps = allowance({"max_env_steps": 10_000}, 100.0).until(phase)
    assert (steps.deadline, steps.max_env_steps) == (math.inf, pytest.approx(share * 10_000, abs=1))


def test_the_last_phase_has_all_of_both():
    both = allowance({"max_seconds": 60, "max_env_steps": 1}).until(Phase.RECORD)
    assert (both.deadline, both.max_env_steps) == (60.0, 1)


def test_the_search_has_what_is_not_needed_after_it():
    without_last = {**KEEPING, "final_keep": 0}
    assert allowance({"max_seconds": 60}, archive=without_last).ends[Phase.SEARCH] == pytest.approx(0.8)
    few = {**MANY, "validation_episodes": 10, "test_episodes": 10}
    # Two trees without an archive, ten episodes of 500 steps, of a million steps, twice.
    ends = allowance({"max_env_steps": 10**6}, archive={"keep": 0}, evaluation=few).ends
    assert ends[Phase.SEARCH] == ends[Phase.FINAL_REFINEMENT] == pytest.approx(0.98)
    seconds = allowance({"max_seconds": 1.0}, archive={"keep": 0}, evaluation=few).ends
    assert seconds[Phase.SEARCH] == pytest.approx(1 - 2 * 3 * 1e-4)
    assert (
        allowance({"max_env_steps": 10**6}, archive=KEEPING, evaluation=few).ends[Phase.FINAL_REFINEMENT]
        < 0.98
    )


def test_recording_takes_a_little_of_what_the_test_has():
    few = {**MANY, "validation_episodes": 10, "test_episodes": 10}
    ends = allowance({"max_env_steps": 10**6}, archive={"keep": 0}, evaluation=few).ends
    assert ends[Phase.VALIDATION] < ends[Phase.TEST] == pytest.approx(1 - 0.001)


def test_rounding_has_a_part_of_its_own_after_the_last_refinement():
    config = config_of(ge={"max_env_steps": 10_000}, archive=KEEPING, evaluation=MANY)
    ends = Allowance.of(config, 0.0, 500, rounds=True).ends
    assert ends[Phase.FINAL_REFINEMENT] - ends[Phase.SEARCH] == pytest.approx(0.1)
    assert ends[Phase.ROUNDING] - ends[Phase.FINAL_REFINEMENT] == pytest.approx(0.1)


@pytest.mark.parametrize(("reason", "given"), [("max_seconds", 14.5), ("max_env_steps", 1_234_567)])
def test_what_was_not_enough_is_never_told_as_enough(reason, given):
    evaluation = {"episodes": 1, "validation_episodes": 1, "test_episodes": 1, "steps_per_second": 1e8}
    told = allowance({reason: given}, evaluation=evaluation).too_small(reason, looked=0.1)
    assert f"ge.{reason}={given} must leave room" in told
    assert float(told.rpartition("=")[2]) >= 1.5 * given
