"""What play shows of an environment."""

import math
import re
import time

import numpy as np
import pytest
from environments_for_tests import (
    BreakoutEnv,
    CountdownEnv,
    EndlessEnv,
    TakingEnv,
    ThrustEnv,
    UnseededEnv,
    WalkEnv,
    register,
)

from ge_torchrl.environments import probing
from ge_torchrl.environments.probing import obeys_seeds, probe
from ge_torchrl.environments.spec import describe


@pytest.fixture(autouse=True)
def forgetful(monkeypatch):
    monkeypatch.setattr(probing, "_probes", {})
    monkeypatch.setattr(probing, "_obedient", {})


@pytest.mark.parametrize(
    ("environment_id", "ranges"),
    [
        ("MountainCar-v0", ((-1.2, 0.6), (-0.07, 0.07))),
        ("Pendulum-v1", ((-1, 1), (-1, 1), (-8, 8))),
    ],
)
def test_declared_bounds_are_the_ranges_where_play_comes_near_them(environment_id, ranges):
    assert probe(describe(environment_id)).ranges == ranges


def test_what_is_seen_is_the_range_where_declared_bounds_say_nothing_or_are_untrue():
    found = probe(describe(register(BreakoutEnv)))
    (first, second) = found.ranges
    assert first == pytest.approx((0, 40), abs=1)
    assert second == pytest.approx((0, 80), abs=2)
    assert found.outside.keys() == {1}
    assert (found.seen_low.tolist(), found.seen_high.tolist()) == ([0, 0], [40, 80])


def test_features_of_two_values_are_noticed():
    one_hot = probe(describe("FrozenLake-v1", wrappers=("gymnasium.wrappers:FlattenObservation",)))
    assert set(one_hot.ranges) == {(0.0, 1.0)}
    assert {0, 1, 4} <= set(one_hot.binary)
    assert probe(describe("Pendulum-v1")).binary == ()


def test_all_ranges_are_finite_and_of_some_width():
    for environment_id in ("CartPole-v1", "Acrobot-v1", register(CountdownEnv), register(ThrustEnv)):
        ranges = np.array(probe(describe(environment_id)).ranges)
        assert np.isfinite(ranges).all()
        assert (ranges[:, 0] < ranges[:, 1]).all()


def test_the_same_is_found_every_time():
    first = probe(describe("CartPole-v1"))
    assert probe(describe("CartPole-v1")) is first
    probing._probes.clear()
    second = probe(describe("CartPole-v1"))
    assert (second.ranges, second.longest) == (first.ranges, first.longest)
    assert not (second.seen_low - first.seen_low).any()


@pytest.mark.parametrize(("kind", "ended", "limit"), [(CountdownEnv, True, 1000), (EndlessEnv, False, 1000)])
def test_an_episode_that_does_not_end_is_noticed(kind, ended, limit):
    found = probe(describe(register(kind)))
    assert (found.ended, found.limit) == (ended, limit)


@pytest.mark.parametrize(
    ("environment_id", "obeys"),
    [("CartPole-v1", True), ("Pendulum-v1", True), (register(WalkEnv), True), (register(UnseededEnv), False)],
)
def test_whether_seeds_are_obeyed(environment_id, obeys):
    assert obeys_seeds(describe(environment_id)) is obeys


@pytest.mark.parametrize("n_steps", [100, 600])
def test_of_a_slow_environment_fewer_steps_are_made_and_that_is_said(monkeypatch, caplog, n_steps):
    monkeypatch.setattr(probing, "_PROBED_STEPS_WHERE_SLOW", ((0.0, n_steps),))
    found = probe(describe("CartPole-v1"))
    assert found.steps == n_steps
    (record,) = caplog.records
    assert f"it was looked at for {n_steps} steps before the run" in record.getMessage()


@pytest.mark.parametrize(("seconds", "n_steps"), [(3.0, 30), (0.3, 10), (math.inf, 100)])
@pytest.mark.usefixtures("own_clock")
def test_a_look_ends_after_the_seconds_that_it_has_but_for_a_few_steps(monkeypatch, caplog, seconds, n_steps):
    monkeypatch.setattr(TakingEnv, "seconds", 0.1)
    found = probe(describe(register(TakingEnv)), seconds)
    assert n_steps <= found.steps <= n_steps + 2
    (record,) = caplog.records
    assert re.search(
        rf"makes 1\d steps a second here: it was looked at for {found.steps} steps", record.getMessage()
    )
    assert np.isfinite(found.ranges).all()


@pytest.mark.usefixtures("own_clock")
def test_other_programs_that_hold_up_some_steps_change_nothing(monkeypatch, caplog):
    taken = iter([1.0 if step % 4 == 0 else 0.0 for step in range(1, 50)])
    monkeypatch.setattr(TakingEnv, "seconds", property(lambda _: next(taken, 0.0)))
    described = describe(register(TakingEnv))
    assert probe(described, math.inf).steps == 3000
    assert not caplog.records


@pytest.mark.usefixtures("own_clock")
def test_seeds_are_tried_for_the_seconds_that_there_are(monkeypatch):
    monkeypatch.setattr(TakingEnv, "seconds", 0.1)
    described, started = describe(register(TakingEnv)), time.perf_counter()
    assert obeys_seeds(described, 1.0)
    assert 0.9 < time.perf_counter() - started < 1.3


def test_a_slow_episode_is_repeated_in_part(monkeypatch):
    monkeypatch.setattr(probing, "_REPEATED_SECONDS", 0.0)
    assert obeys_seeds(describe("CartPole-v1"))
    assert not obeys_seeds(describe(register(UnseededEnv)))
