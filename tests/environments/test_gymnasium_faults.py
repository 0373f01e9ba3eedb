"""What an environment does wrong is told in one line, or warned of once and scored as it is."""

import logging
import re

import faulty_environments as faulty
import numpy as np
import pytest
from environments_for_tests import (
    EndlessEnv,
)
from gymnasium_for_tests import LEFT_OF_THE_MIDDLE, plain_gymnasium

from ge_torchrl.environments import spec
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split


def test_an_observation_outside_its_bounds_is_warned_of_once_and_the_bound_is_given_up(
    open_gymnasium, caplog
):
    backend = open_gymnasium(faulty.WideEnv)
    assert [record.levelno for record in caplog.records] == [logging.WARNING]
    assert "x0 = " in caplog.text
    assert "declared: 0 to 1" in caplog.text
    backend.evaluate(Forest.stack([LEFT_OF_THE_MIDDLE]), np.arange(20), "fitness")
    assert len(caplog.records) == 1
    low, high = backend.bounds
    assert (low.tolist(), high.tolist()) == ([-np.inf, 0], [np.inf, 1])


def test_what_lies_outside_the_bounds_is_scored_as_it_is(open_gymnasium):
    """By its bounds, all that this environment observes would be below 1.5."""
    tree = split(0, 1.5, leaf(0), leaf(1))
    backend = open_gymnasium(faulty.WideEnv)
    outcomes = backend.evaluate(Forest.stack([tree, leaf(0)]), np.arange(20), "fitness")
    assert outcomes.returns[0].tolist() == [plain_gymnasium(backend.spec.id, tree, e)[0] for e in range(20)]
    assert outcomes.returns[0].tolist() != outcomes.returns[1].tolist()


def test_an_infinite_entry_is_warned_of_once_and_played(open_gymnasium, caplog):
    backend = open_gymnasium(faulty.InfiniteEnv)
    backend.evaluate(Forest.stack([split(1, 3.0, leaf(0), leaf(1))]), np.arange(20), "fitness", visits=True)
    assert len(caplog.records) == 1
    assert "x1 = inf" in caplog.text
    low, high = backend.bounds
    assert (low.tolist(), high.tolist()) == ([-5, -np.inf], [5, np.inf])


def test_a_late_violation_is_warned_of_and_the_bound_is_given_up(open_gymnasium, caplog):
    backend = open_gymnasium(faulty.LateEnv)
    assert backend.bounds[1].tolist() == [5, 5]
    backend.evaluate(Forest.stack([leaf(0)]), np.arange(20), "fitness")
    assert not caplog.records
    backend.evaluate(Forest.stack([leaf(0)]), np.array([9999, 9999]), "fitness")
    assert len(caplog.records) == 1
    assert backend.bounds[1].tolist() == [5, np.inf]


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        (
            faulty.RaisingEnv,
            r"raised RuntimeError\('the motor\\nis on fire'\); episode seed 0, step 2, action",
        ),
        (faulty.RaisingInResetEnv, r"raised RuntimeError\('no fuel'\) in reset; episode seed 0, step 0$"),
        (faulty.LeavingEnv, r"raised SystemExit\('licence expired'\); episode seed 0, step 2, action"),
        (faulty.LeavingInResetEnv, r"raised SystemExit\(3\) in reset; episode seed 0, step 0$"),
        (faulty.NaNEnv, r"returned an observation with NaN, \[nan, nan\]; episode seed 0, step 1, action"),
        (
            faulty.NaNRewardEnv,
            r"returned a reward that is not a finite number, nan; episode seed 0, step 0, action",
        ),
        (
            faulty.InfiniteRewardEnv,
            r"returned a reward that is not a finite number, -inf; episode seed 0, step 0",
        ),
        (faulty.OddRewardEnv, r"must return a reward that is one number; got None; episode seed 0, step 0"),
        (faulty.ArrayRewardEnv, r"reward that is one number; got array\(\[1\.\]\); episode seed 0, step 0"),
        (faulty.OddObservationEnv, r"observations of 2 numbers.*got None.*; episode seed 0, step 0, action"),
        (faulty.ColumnEnv, r"observations of 2 numbers.*shape \(2, 1\).*; episode seed 0, step 0, action"),
        (faulty.LongEnv, r"observations of 2 numbers.*shape \(3,\).*; episode seed 0, step 0, action"),
        (faulty.ScalarEnv, r"observations of 2 numbers.*shape \(\).*; episode seed 0, step 0, action"),
        (faulty.TextEnv, r"observations of 2 numbers.*'left'.*; episode seed 0, step 0, action"),
        (
            faulty.FourValuesEnv,
            r"ValueError.* \(an observation, .* and a dict are expected of step\); .*, step 0, action [01] \(a[01]\)",
        ),
        (
            faulty.BareResetEnv,
            r"must return an observation and a dict from reset; got \(.*\); episode seed 0, step 0$",
        ),
        (
            faulty.TripleResetEnv,
            r"raised ValueError.* in reset \(an observation and a dict are expected of reset\); episode seed 0",
        ),
    ],
)
def test_faults_are_found_before_the_first_generation_in_one_line(open_gymnasium, kind, expected):
    with pytest.raises(EnvironmentFaultError, match=expected) as caught:
        open_gymnasium(kind)
    assert str(caught.value).startswith(f"env.id=Test{kind.__name__}-v0 ")
    assert "\n" not in str(caught.value)


def test_a_late_fault_names_seed_step_and_action_and_its_steps_are_counted(open_gymnasium):
    backend = open_gymnasium(faulty.LateNaNEnv)
    with pytest.raises(EnvironmentFaultError, match=r"NaN.*; episode seed 9999, step 2, action 1 \(a1\)"):
        backend.evaluate(Forest.stack([leaf(1)]), np.array([9999]), "fitness")
    assert backend.steps == {"fitness": 2}


@pytest.mark.parametrize("fault", faulty.LATE_FAULTS)
def test_late_faults_are_one_line_with_id_seed_step_and_action(open_gymnasium, monkeypatch, fault):
    monkeypatch.setattr(faulty.LateFaultEnv, "fault", fault)
    backend = open_gymnasium(faulty.LateFaultEnv)
    with pytest.raises(EnvironmentFaultError) as caught:
        backend.evaluate(Forest.stack([leaf(1)]), np.array([9999]), "fitness")
    where = r"; episode seed 9999, step 2, action 1 \(a1\)"
    expected = r"env\.id=TestLateFaultEnv-v0 " + faulty.LATE_FAULTS[fault][2] + where
    assert re.fullmatch(expected, str(caught.value))
    assert backend.steps == {"fitness": 2}


def test_an_endless_episode_is_truncated_with_one_word_of_warning(open_gymnasium, monkeypatch, caplog):
    monkeypatch.setattr(spec, "UNBOUNDED_EPISODE_STEPS", 5000)
    backend = open_gymnasium(EndlessEnv)
    for _ in range(2):
        assert (backend.evaluate(Forest.stack([leaf(0)]), np.arange(2), "fitness").lengths == 5000).all()
    assert len(caplog.records) == 1
    assert "truncated after 5000 steps (env.max_episode_steps" in caplog.text
    assert backend.record(leaf(0), 0).truncated
