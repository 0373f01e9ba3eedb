"""The Gymnasium backend is a plain Gymnasium loop: same episodes, every step counted, every limit held."""

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
)
from gymnasium_for_tests import LEFT_OF_THE_MIDDLE, TREES, plain_gymnasium

from ge_torchrl.environments import gymnasium_backend
from ge_torchrl.environments.backend import Limit, LimitReachedError
from ge_torchrl.environments.spec import describe
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split


@pytest.mark.parametrize("environment_id", TREES)
def test_it_is_a_plain_gymnasium_loop(open_gymnasium, environment_id):
    if environment_id == "LunarLander-v3":
        pytest.importorskip("Box2D")
    trees = [TREES[environment_id], leaf(0), leaf(1)]
    outcomes = open_gymnasium(describe(environment_id)).evaluate(Forest.stack(trees), np.arange(4), "fitness")
    for p, tree in enumerate(trees):
        for e in range(4):
            expected = plain_gymnasium(environment_id, tree, e)
            assert (outcomes.returns[p, e], outcomes.lengths[p, e]) == expected


@pytest.mark.parametrize(
    ("kind", "first_action"),
    [(Float64WalkEnv, 0), (Int64WalkEnv, 0), (UInt8WalkEnv, 0), (BoolWalkEnv, 0), (FromOneEnv, 1)],
)
def test_observations_of_any_type_and_actions_from_any_number(open_gymnasium, kind, first_action):
    tree = split(0, 0.5, leaf(1), split(1, 0.5, leaf(0), leaf(1)))
    backend = open_gymnasium(kind)
    outcomes = backend.evaluate(Forest.stack([tree]), np.arange(20), "fitness")
    for e in range(20):
        expected = plain_gymnasium(backend.spec.id, tree, e, first_action)
        assert (outcomes.returns[0, e], outcomes.lengths[0, e]) == expected
    assert backend.record(tree, 3).observations.dtype == np.float32


def test_sums_of_weighted_features_decide_too(open_gymnasium):
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
    outcomes = open_gymnasium(describe("CartPole-v1")).evaluate(
        Forest.stack([leaf(0), tree]), np.arange(3), "fitness"
    )
    assert [plain_gymnasium("CartPole-v1", tree, e)[0] for e in range(3)] == outcomes.returns[1].tolist()
    assert outcomes.returns[1].min() > outcomes.returns[0].max()


def test_an_individual_without_a_tree_has_no_episodes(open_gymnasium):
    trees = Forest.stack([leaf(0), leaf(1)]).arrays
    gap = Forest(
        trees._replace(split_start=np.zeros(4, np.int64), leaf_start=np.array([0, 1, 1, 2], np.int64))
    )
    outcomes = open_gymnasium(describe("CartPole-v1")).evaluate(gap, np.arange(5), "fitness", visits=True)
    assert np.isnan(outcomes.returns[1]).all()
    assert (outcomes.lengths[1] == 0).all()
    assert (outcomes.returns[[0, 2]] > 0).all()
    assert outcomes.leaf_visits.tolist() == outcomes.lengths[[0, 2]].sum(axis=1).tolist()


def test_visits_are_counted_while_measuring_and_the_ledger_is_true_to_the_step(open_gymnasium):
    backend = open_gymnasium(CountingEnv)
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


def test_the_first_steps_are_timed_and_not_counted(open_gymnasium):
    backend = open_gymnasium(CountdownEnv)
    assert backend.steps == Counter()
    assert 1000 < backend.steps_per_second < 1e8


def test_an_episode_is_written_down_step_by_step(open_gymnasium):
    backend = open_gymnasium(describe("CartPole-v1"))
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


def test_the_limit_of_an_episode_truncates_as_gymnasium_does(open_gymnasium):
    for limit in (37, None):
        backend = open_gymnasium(describe("MountainCar-v0", max_episode_steps=limit))
        outcomes = backend.evaluate(Forest.stack([leaf(1)]), np.arange(3), "fitness")
        assert (outcomes.returns == -(limit or 200)).all()
        trajectory = backend.record(leaf(1), 0)
        assert (trajectory.terminated, trajectory.truncated) == (False, True)


def test_arguments_and_wrappers_that_change_something_are_kept(open_gymnasium):
    described = describe(
        "MountainCar-v0", max_episode_steps=9, wrappers=("environments_for_tests:DoubledReward",)
    )
    outcomes = open_gymnasium(described).evaluate(Forest.stack([leaf(1)]), np.arange(2), "fitness")
    assert (outcomes.returns == -18).all()


def test_what_trees_see_is_their_training_episodes_step_by_step(open_gymnasium):
    backend = open_gymnasium(describe("CartPole-v1"))
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


def test_what_a_tree_sees_does_not_depend_on_its_company(open_gymnasium):
    backend = open_gymnasium(WalkEnv)
    trees = [leaf(0), leaf(1), LEFT_OF_THE_MIDDLE]
    together = backend.observe(trees, 60, [np.random.default_rng(r) for r in range(3)], "refinement")
    for r in range(3):
        alone = backend.observe([trees[r]], 60, [np.random.default_rng(r)], "refinement")
        np.testing.assert_array_equal(alone[0], together[r])


def test_jobs_give_their_results_in_their_order(open_gymnasium):
    backend = open_gymnasium(CountdownEnv)
    jobs = [lambda own, a=a: own.evaluate(Forest.stack([leaf(a)]), np.arange(1), "fitness") for a in (1, 0)]
    assert [outcomes.returns.item() for outcomes in backend.run_jobs(jobs)] == [18, 15]
    assert backend.run_jobs([]) == []


def test_a_limit_on_steps_holds_to_the_step(open_gymnasium):
    backend = open_gymnasium(EndlessEnv)
    for most in (1000, 12345):
        backend.limit = Limit(max_env_steps=backend.steps.total() + most)
        before = backend.steps.total()
        with pytest.raises(LimitReachedError) as caught:
            backend.evaluate(Forest.stack([leaf(0)]), np.array([0]), "fitness")
        assert caught.value.reason == "max_env_steps"
        assert backend.steps.total() - before == most + 1
        with pytest.raises(LimitReachedError):
            backend.record(leaf(0), 0)


def test_exactly_as_many_steps_as_allowed_are_allowed(open_gymnasium):
    backend = open_gymnasium(CountdownEnv)
    backend.limit = Limit(max_env_steps=30)
    assert backend.evaluate(Forest.stack([leaf(0)]), np.arange(10), "fitness").env_steps == 30
    with pytest.raises(LimitReachedError):
        backend.evaluate(Forest.stack([leaf(0)]), np.arange(1), "fitness")
    assert backend.steps.total() == 30


@pytest.mark.usefixtures("own_clock")
def test_a_deadline_ends_a_long_episode_and_signs_of_life_come_before(open_gymnasium, monkeypatch):
    monkeypatch.setattr(gymnasium_backend, "_PROBED_STEPS", 10)
    backend = open_gymnasium(SlowEnv)
    beats = []
    backend.on_steps = beats.append
    started = time.perf_counter()
    backend.limit = Limit(deadline=started + 1.0)
    with pytest.raises(LimitReachedError) as caught:
        backend.evaluate(Forest.stack([leaf(0)]), np.array([0]), "fitness")
    assert caught.value.reason == "max_seconds"
    assert 1.0 <= time.perf_counter() - started < 1.05
    assert len(beats) >= 3
    assert beats == sorted(beats)
