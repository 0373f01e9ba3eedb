"""The Gymnasium backend is a plain Gymnasium loop: same episodes, every step counted, every limit held."""

import logging
import os
import time
from collections import Counter

import gymnasium as gym
import numpy as np
import pytest
from environments_for_tests import (
    BoolWalkEnv,
    CountdownEnv,
    CountingEnv,
    EndlessEnv,
    Float64WalkEnv,
    FromOneEnv,
    Int64WalkEnv,
    SlowEnv,
    UInt8WalkEnv,
    WalkEnv,
    register,
)

import faulty_environments as faulty
from ge_torchrl.environments import gymnasium_backend, gymnasium_workers, spec
from ge_torchrl.environments.backend import Limit, LimitReachedError
from ge_torchrl.environments.gymnasium_backend import GymnasiumBackend
from ge_torchrl.environments.spec import describe
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split

TREES = {
    "CartPole-v1": split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1)),
    "Acrobot-v1": split(5, -14.2778, leaf(0), split(5, 0.3094, leaf(0), leaf(2))),
    "MountainCar-v0": split(1, -0.0005, split(0, -1.0361, leaf(2), leaf(0)), leaf(2)),
    "LunarLander-v3": split(4, -0.07, leaf(1), split(3, -0.3, leaf(2), leaf(3))),
}
LEFT_OF_THE_MIDDLE = split(0, 0.0, leaf(1), leaf(0))


@pytest.fixture
def opened():
    """Return a backend that is closed when the test ends."""
    backends = []

    def opened(described, workers=1):
        if isinstance(described, type):
            described = describe(register(described))
        backends.append(GymnasiumBackend(described, workers))
        return backends[-1]

    yield opened
    for backend in backends:
        backend.close()


def plain_gymnasium(environment_id, tree, seed, first_action=0):
    """The oracle: one episode, as anybody would write it."""
    environment = gym.make(environment_id, disable_env_checker=True)
    observation, _ = environment.reset(seed=int(seed))
    total, length, ended = 0.0, 0, False
    while not ended:
        action = int(tree.decide(np.float32([observation]))[0]) + first_action
        observation, reward, terminated, truncated, _ = environment.step(action)
        total, length, ended = total + reward, length + 1, terminated or truncated
    return total, length


@pytest.mark.parametrize("environment_id", TREES)
def test_it_is_a_plain_gymnasium_loop(opened, environment_id):
    if environment_id == "LunarLander-v3":
        pytest.importorskip("Box2D")
    trees = [TREES[environment_id], leaf(0), leaf(1)]
    outcomes = opened(describe(environment_id)).evaluate(Forest.stack(trees), np.arange(4), "fitness")
    for p, tree in enumerate(trees):
        for e in range(4):
            expected = plain_gymnasium(environment_id, tree, e)
            assert (outcomes.returns[p, e], outcomes.lengths[p, e]) == expected


@pytest.mark.parametrize(
    ("kind", "first_action"),
    [(Float64WalkEnv, 0), (Int64WalkEnv, 0), (UInt8WalkEnv, 0), (BoolWalkEnv, 0), (FromOneEnv, 1)],
)
def test_observations_of_any_type_and_actions_from_any_number(opened, kind, first_action):
    tree = split(0, 0.5, leaf(1), split(1, 0.5, leaf(0), leaf(1)))
    backend = opened(kind)
    outcomes = backend.evaluate(Forest.stack([tree]), np.arange(20), "fitness")
    for e in range(20):
        expected = plain_gymnasium(backend.spec.id, tree, e, first_action)
        assert (outcomes.returns[0, e], outcomes.lengths[0, e]) == expected
    assert backend.record(tree, 3).observations.dtype == np.float32


def test_sums_of_weighted_features_decide_too(opened):
    tree = DecisionTree(
        children_left=np.int32([~0]),
        children_right=np.int32([~1]),
        term_start=np.int32([0, 2]),
        feature=np.int32([2, 3]),
        weight=np.float32([0.7, 0.3]),
        threshold=np.float32([0.01]),
        action=np.int32([0, 1]),
        value=np.zeros((2, 0), np.float32),
        leaf_term_start=np.zeros(3, np.int32),
        leaf_feature=np.zeros(0, np.int32),
        leaf_weight=np.zeros((0, 0), np.float32),
    )
    outcomes = opened(describe("CartPole-v1")).evaluate(Forest.stack([leaf(0), tree]), np.arange(3), "fitness")
    assert [plain_gymnasium("CartPole-v1", tree, e)[0] for e in range(3)] == outcomes.returns[1].tolist()
    assert outcomes.returns[1].min() > outcomes.returns[0].max()


def test_an_individual_without_a_tree_has_no_episodes(opened):
    trees = Forest.stack([leaf(0), leaf(1)]).arrays
    gap = Forest(
        trees._replace(split_start=np.zeros(4, np.int64), leaf_start=np.array([0, 1, 1, 2], np.int64))
    )
    outcomes = opened(describe("CartPole-v1")).evaluate(gap, np.arange(5), "fitness", visits=True)
    assert np.isnan(outcomes.returns[1]).all()
    assert (outcomes.lengths[1] == 0).all()
    assert (outcomes.returns[[0, 2]] > 0).all()
    assert outcomes.leaf_visits.tolist() == outcomes.lengths[[0, 2]].sum(axis=1).tolist()


def test_visits_are_counted_while_measuring_and_the_ledger_is_true_to_the_step(opened):
    backend = opened(CountingEnv)
    trees = [LEFT_OF_THE_MIDDLE, split(0, 2.5, split(1, 0.5, leaf(0), leaf(1)), leaf(0)), leaf(1)]
    made = CountingEnv.steps_made
    outcomes = backend.evaluate(Forest.stack(trees), np.arange(30), "fitness", visits=True)
    assert CountingEnv.steps_made - made == outcomes.env_steps
    np.testing.assert_array_equal(
        np.add.reduceat(outcomes.leaf_visits, [0, 2, 5]), outcomes.lengths.sum(axis=1)
    )
    backend.observe(trees, 50, [np.random.default_rng(r) for r in range(3)], "refinement")
    trajectory = backend.record(trees[1], 7)
    assert backend.steps == {
        "fitness": outcomes.env_steps,
        "refinement": 150,
        "record": len(trajectory.actions),
    }
    assert CountingEnv.steps_made - made == backend.steps.total()
    # What a tree sees tells which leaf decides.
    seen = np.concatenate([backend.record(trees[0], e).observations[:-1] for e in range(30)])
    assert np.bincount(trees[0].leaf_of(seen)).tolist() == outcomes.leaf_visits[:2].tolist()


def test_the_first_steps_are_timed_and_not_counted(opened):
    backend = opened(CountdownEnv)
    assert backend.steps == Counter()
    assert 1000 < backend.steps_per_second < 1e8


def test_an_episode_is_written_down_step_by_step(opened):
    backend = opened(describe("CartPole-v1"))
    trajectory = backend.record(leaf(1), 5)
    environment = gym.make("CartPole-v1")
    observation, _ = environment.reset(seed=5)
    for t, ours in enumerate(trajectory.observations):
        np.testing.assert_array_equal(ours, observation)
        if t < len(trajectory.actions):
            observation, reward, terminated, _, _ = environment.step(1)
            assert trajectory.rewards[t] == reward
    assert terminated
    assert (trajectory.terminated, trajectory.truncated) == (True, False)
    assert trajectory.actions.tolist() == [1] * (len(trajectory.observations) - 1)


def test_the_limit_of_an_episode_truncates_as_gymnasium_does(opened):
    for limit in (37, None):
        backend = opened(describe("MountainCar-v0", max_episode_steps=limit))
        outcomes = backend.evaluate(Forest.stack([leaf(1)]), np.arange(3), "fitness")
        assert (outcomes.returns == -(limit or 200)).all()
        trajectory = backend.record(leaf(1), 0)
        assert (trajectory.terminated, trajectory.truncated) == (False, True)


def test_arguments_and_wrappers_that_change_something_are_kept(opened):
    described = describe(
        "MountainCar-v0", max_episode_steps=9, wrappers=("environments_for_tests:DoubledReward",)
    )
    outcomes = opened(described).evaluate(Forest.stack([leaf(1)]), np.arange(2), "fitness")
    assert (outcomes.returns == -18).all()


def test_what_trees_see_is_their_training_episodes_step_by_step(opened):
    backend = opened(describe("CartPole-v1"))
    trees = [leaf(0), TREES["CartPole-v1"]]
    seen = backend.observe(trees, 400, [np.random.default_rng(r) for r in range(2)], "refinement")
    assert (seen.shape, seen.dtype) == ((2, 400, 4), np.float32)
    for r, tree in enumerate(trees):
        rng = np.random.default_rng(r)
        expected = []
        while len(expected) < 400:
            for seed in episode_seeds("training", 32, rng):
                expected += list(backend.record(tree, seed).observations[:-1])
        np.testing.assert_array_equal(seen[r], expected[:400])


def test_what_a_tree_sees_does_not_depend_on_its_company(opened):
    backend = opened(WalkEnv)
    trees = [leaf(0), leaf(1), LEFT_OF_THE_MIDDLE]
    together = backend.observe(trees, 60, [np.random.default_rng(r) for r in range(3)], "refinement")
    for r in range(3):
        alone = backend.observe([trees[r]], 60, [np.random.default_rng(r)], "refinement")
        np.testing.assert_array_equal(alone[0], together[r])


def test_jobs_give_their_results_in_their_order(opened):
    backend = opened(CountdownEnv)
    jobs = [lambda own, a=a: own.evaluate(Forest.stack([leaf(a)]), np.arange(1), "fitness") for a in (1, 0)]
    assert [outcomes.returns.item() for outcomes in backend.run_jobs(jobs)] == [18, 15]
    assert backend.run_jobs([]) == []


def test_a_limit_on_steps_holds_to_the_step(opened):
    backend = opened(EndlessEnv)
    for most in (1000, 12345):
        backend.limit = Limit(max_env_steps=backend.steps.total() + most)
        before = backend.steps.total()
        with pytest.raises(LimitReachedError) as caught:
            backend.evaluate(Forest.stack([leaf(0)]), np.array([0]), "fitness")
        assert caught.value.reason == "max_env_steps"
        assert backend.steps.total() - before == most + 1
        with pytest.raises(LimitReachedError):
            backend.record(leaf(0), 0)


def test_exactly_as_many_steps_as_allowed_are_allowed(opened):
    backend = opened(CountdownEnv)
    backend.limit = Limit(max_env_steps=30)
    assert backend.evaluate(Forest.stack([leaf(0)]), np.arange(10), "fitness").env_steps == 30
    with pytest.raises(LimitReachedError):
        backend.evaluate(Forest.stack([leaf(0)]), np.arange(1), "fitness")
    assert backend.steps.total() == 30


def test_a_deadline_ends_a_long_episode_and_signs_of_life_come_before(opened, monkeypatch):
    monkeypatch.setattr(gymnasium_backend, "_PROBED_STEPS", 10)
    backend = opened(SlowEnv)
    beats = []
    backend.on_steps = beats.append
    started = time.perf_counter()
    backend.limit = Limit(deadline=started + 1.0)
    with pytest.raises(LimitReachedError) as caught:
        backend.evaluate(Forest.stack([leaf(0)]), np.array([0]), "fitness")
    assert caught.value.reason == "max_seconds"
    assert 1.0 <= time.perf_counter() - started < 1.1
    assert len(beats) >= 3
    assert beats == sorted(beats)


# ---------------------------------------------------------------- what an environment does wrong


def test_an_observation_outside_its_bounds_is_warned_of_once_and_the_bound_is_given_up(opened, caplog):
    backend = opened(faulty.WideEnv)
    assert [record.levelno for record in caplog.records] == [logging.WARNING]
    assert "x0 = " in caplog.text
    assert "declared: 0 to 1" in caplog.text
    backend.evaluate(Forest.stack([LEFT_OF_THE_MIDDLE]), np.arange(20), "fitness")
    assert len(caplog.records) == 1
    low, high = backend.bounds
    assert (low.tolist(), high.tolist()) == ([-np.inf, 0], [np.inf, 1])


def test_what_lies_outside_the_bounds_is_scored_as_it_is(opened):
    """By its bounds, all that this environment observes would be below 1.5."""
    tree = split(0, 1.5, leaf(0), leaf(1))
    backend = opened(faulty.WideEnv)
    outcomes = backend.evaluate(Forest.stack([tree, leaf(0)]), np.arange(20), "fitness")
    assert outcomes.returns[0].tolist() == [plain_gymnasium(backend.spec.id, tree, e)[0] for e in range(20)]
    assert outcomes.returns[0].tolist() != outcomes.returns[1].tolist()


def test_an_infinite_entry_is_warned_of_once_and_played(opened, caplog):
    backend = opened(faulty.InfiniteEnv)
    backend.evaluate(Forest.stack([split(1, 3.0, leaf(0), leaf(1))]), np.arange(20), "fitness", visits=True)
    assert len(caplog.records) == 1
    assert "x1 = inf" in caplog.text
    low, high = backend.bounds
    assert (low.tolist(), high.tolist()) == ([-5, -np.inf], [5, np.inf])


def test_a_late_violation_is_warned_of_and_the_bound_is_given_up(opened, caplog):
    backend = opened(faulty.LateEnv)
    assert backend.bounds[1].tolist() == [5, 5]
    backend.evaluate(Forest.stack([leaf(0)]), np.arange(20), "fitness")
    assert not caplog.records
    backend.evaluate(Forest.stack([leaf(0)]), np.array([9999, 9999]), "fitness")
    assert len(caplog.records) == 1
    assert backend.bounds[1].tolist() == [5, np.inf]


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        (faulty.RaisingEnv, r"raised RuntimeError\('the motor\\nis on fire'\); episode seed 0, step 2, action"),
        (faulty.RaisingInResetEnv, r"raised RuntimeError\('no fuel'\) in reset; episode seed 0, step 0$"),
        (faulty.NaNEnv, r"returned an observation with NaN, \[nan, nan\]; episode seed 0, step 1, action"),
        (faulty.NaNRewardEnv, r"returned a reward that is not a finite number, nan; episode seed 0, step 0, action"),
        (faulty.InfiniteRewardEnv, r"returned a reward that is not a finite number, -inf; episode seed 0, step 0"),
        (faulty.OddRewardEnv, r"must return a reward that is one number; got None; episode seed 0, step 0"),
        (faulty.ArrayRewardEnv, r"reward that is one number; got array\(\[1\.\]\); episode seed 0, step 0"),
        (faulty.OddObservationEnv, r"observations of 2 numbers.*got None.*; episode seed 0, step 0, action"),
        (faulty.ColumnEnv, r"observations of 2 numbers.*shape \(2, 1\).*; episode seed 0, step 0, action"),
        (faulty.LongEnv, r"observations of 2 numbers.*shape \(3,\).*; episode seed 0, step 0, action"),
        (faulty.ScalarEnv, r"observations of 2 numbers.*shape \(\).*; episode seed 0, step 0, action"),
        (faulty.TextEnv, r"observations of 2 numbers.*'left'.*; episode seed 0, step 0, action"),
        (faulty.FourValuesEnv, r"raised ValueError.*; episode seed 0, step 0, action [01] \(a[01]\)"),
    ],
)
def test_faults_are_found_before_the_first_generation_in_one_line(opened, kind, expected):
    with pytest.raises(EnvironmentFaultError, match=expected) as caught:
        opened(kind)
    assert str(caught.value).startswith(f"env.id=Test{kind.__name__}-v0 ")
    assert "\n" not in str(caught.value)


def test_a_late_fault_names_seed_step_and_action_and_its_steps_are_counted(opened):
    backend = opened(faulty.LateNaNEnv)
    with pytest.raises(EnvironmentFaultError, match=r"NaN.*; episode seed 9999, step 2, action 1 \(a1\)"):
        backend.evaluate(Forest.stack([leaf(1)]), np.array([9999]), "fitness")
    assert backend.steps == {"fitness": 2}


def test_an_endless_episode_is_truncated_with_one_word_of_warning(opened, monkeypatch, caplog):
    monkeypatch.setattr(spec, "UNBOUNDED_EPISODE_STEPS", 5000)
    backend = opened(EndlessEnv)
    for _ in range(2):
        assert (backend.evaluate(Forest.stack([leaf(0)]), np.arange(2), "fitness").lengths == 5000).all()
    assert len(caplog.records) == 1
    assert "truncated after 5000 steps (env.max_episode_steps" in caplog.text
    assert backend.record(leaf(0), 0).truncated


# ---------------------------------------------------------------- worker processes


def test_processes_change_nothing_and_a_fault_in_one_leaves_them_usable(opened):
    described = describe(register(faulty.LateNaNEnv))
    alone, together = opened(described, workers=1), opened(described, workers=2)
    trees = Forest.stack([LEFT_OF_THE_MIDDLE, leaf(0), split(0, 2.5, split(1, 0.5, leaf(0), leaf(1)), leaf(0))])
    for _ in range(2):
        ours = together.evaluate(trees, np.arange(50), "fitness", visits=True)
        theirs = alone.evaluate(trees, np.arange(50), "fitness", visits=True)
        np.testing.assert_array_equal(ours.returns, theirs.returns)
        np.testing.assert_array_equal(ours.lengths, theirs.lengths)
        np.testing.assert_array_equal(ours.leaf_visits, theirs.leaf_visits)
        assert together.steps == alone.steps
        with pytest.raises(EnvironmentFaultError, match=r"NaN.*; episode seed 9999, step 2, action"):
            together.evaluate(Forest.stack([leaf(0), leaf(1)]), np.array([9999, 9999, 9999]), "faults")
        del together.steps["faults"]
    rngs = [[np.random.default_rng(r) for r in range(4)] for _ in range(2)]
    four = trees.take([0, 1, 2, 0]).trees()
    seen = [backend.observe(four, 90, own, "refinement") for backend, own in zip((together, alone), rngs, strict=True)]
    np.testing.assert_array_equal(*seen)
    assert together.steps == alone.steps


def test_a_module_prefix_works_in_worker_processes(opened):
    pytest.importorskip("Box2D")
    described = describe("gymnasium:LunarLander-v3")
    forest = Forest.stack([TREES["LunarLander-v3"]])
    ours = opened(described, workers=2).evaluate(forest, np.arange(4), "fitness")
    assert ours.returns[0].tolist() == [
        plain_gymnasium("LunarLander-v3", TREES["LunarLander-v3"], e)[0] for e in range(4)
    ]


def test_limits_and_signs_of_life_hold_in_worker_processes(opened, monkeypatch):
    monkeypatch.setattr(gymnasium_backend, "_PROBED_STEPS", 10)
    backend = opened(SlowEnv, workers=2)
    forest, seeds = Forest.stack([leaf(0)]), np.arange(4)
    backend.limit = Limit(max_env_steps=300)
    with pytest.raises(LimitReachedError):
        backend.evaluate(forest, seeds, "fitness")
    # Two workers make 1000 steps a second at most and are looked at ten times a second.
    assert 300 < backend.steps.total() < 500
    beats = []
    backend.on_steps = beats.append
    started = time.perf_counter()
    backend.limit = Limit(deadline=started + 3.0)
    before = backend.steps.total()
    with pytest.raises(LimitReachedError) as caught:
        backend.evaluate(forest, seeds, "fitness")
    assert caught.value.reason == "max_seconds"
    assert 3.0 <= time.perf_counter() - started < 3.3
    assert len(beats) >= 4
    assert beats == sorted(beats)
    assert backend.steps.total() > before + 300
    backend.limit = None


def test_a_worker_that_dies_is_one_line_and_later_calls_begin_anew(opened, monkeypatch):
    monkeypatch.setenv("TEST_ENVIRONMENT_LIVES_IN", str(os.getpid()))
    backend = opened(faulty.DyingEnv, workers=2)
    forest = Forest.stack([leaf(0)])
    with pytest.raises(EnvironmentFaultError, match=r"worker process.*died.*env\.workers=1") as caught:
        backend.evaluate(forest, np.arange(4), "fitness")
    assert "\n" not in str(caught.value)
    # So few episodes are played in this process.
    assert backend.evaluate(forest, np.arange(3), "fitness").env_steps == 9


def unpicklable():
    class LocalEnv(WalkEnv):
        pass

    return LocalEnv


def test_an_environment_that_cannot_be_sent_is_told_or_played_here(opened, monkeypatch, caplog):
    described = describe(register(unpicklable()))
    forest = Forest.stack([leaf(0)])
    with pytest.raises(EnvironmentFaultError, match=r'cannot be sent to worker.*"module:Class".*env\.workers=1'):
        opened(described, workers=2).evaluate(forest, np.arange(4), "fitness")
    monkeypatch.setattr(gymnasium_backend, "_START_SECONDS", 0.0)
    monkeypatch.setattr(gymnasium_backend, "available_cores", lambda: 2)
    assert opened(described, workers=0).evaluate(forest, np.arange(4), "fitness").env_steps > 0
    assert "running in this process alone" in caplog.text


def test_only_the_cores_of_this_process_are_counted(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3, 5, 7}, raising=False)
    assert gymnasium_workers.available_cores() == 3
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert gymnasium_workers.available_cores() == 1
