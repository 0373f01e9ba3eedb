import math

import pytest
from problems_for_tests import config_of

from ge_torchrl.run.allowance import Allowance, Phase


def test_without_limits_a_run_may_take_what_it_takes():
    allowance = Allowance.of(config_of(), started=100.0)
    assert [allowance.until(phase) for phase in Phase] == [None] * 4
    unlimited = Allowance.of(config_of(ge={"max_env_steps": 0}), started=100.0)
    assert [unlimited.until(phase) for phase in Phase] == [None] * 4


@pytest.mark.parametrize(
    ("phase", "share"),
    [(Phase.SEARCH, 0.7), (Phase.FINAL_REFINEMENT, 0.8), (Phase.VALIDATION, 0.9), (Phase.TEST, 1.0)],
)
def test_each_phase_ends_so_that_the_next_has_its_part(phase, share):
    seconds = Allowance.of(config_of(ge={"max_seconds": 60}), started=100.0).until(phase)
    assert (seconds.deadline, seconds.max_env_steps) == (pytest.approx(100 + share * 60), None)
    steps = Allowance.of(config_of(ge={"max_env_steps": 10_000}), started=100.0).until(phase)
    assert (steps.deadline, steps.max_env_steps) == (math.inf, share * 10_000)


def test_the_last_phase_has_all_of_both():
    both = Allowance.of(config_of(ge={"max_seconds": 60, "max_env_steps": 1}), started=0.0).until(Phase.TEST)
    assert (both.deadline, both.max_env_steps) == (60.0, 1)
