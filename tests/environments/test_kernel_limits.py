"""The kernel backend's jobs, its limits of steps and of time, and its signs of life."""

import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from trees_of_all_kinds import PUBLISHED

from ge_torchrl.environments import kernel_backend
from ge_torchrl.environments.backend import Ledger, Limit, LimitReachedError
from ge_torchrl.environments.threads import Task, Threads
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

leaf = DecisionTree.leaf


@pytest.mark.parametrize("n_threads", [1, 2])
def test_jobs_give_their_results_in_their_order_and_their_errors(n_threads, opened):
    backend = opened("CartPole-v1", n_threads)
    interval, seeds = sys.getswitchinterval(), np.arange(3)
    job_trees = [leaf(0), leaf(1), PUBLISHED["CartPole-v1"][0]]

    def job(tree):
        return lambda own: own.evaluate(Forest.stack([tree]), seeds, "polish").returns[0].tolist()

    def broken(_):
        raise ValueError("a job broke")

    together = backend.run_jobs([job(tree) for tree in job_trees])
    counted = backend.steps["polish"]
    expected = [backend.evaluate(Forest.stack([tree]), seeds, "again") for tree in job_trees]
    assert together == [outcomes.returns[0].tolist() for outcomes in expected]
    assert counted == backend.steps["again"]
    assert backend.run_jobs([]) == []
    with pytest.raises(ValueError, match="a job broke"):
        backend.run_jobs([job(job_trees[0]), broken])
    assert backend.limit is None
    assert sys.getswitchinterval() == interval, "Python's threads take turns as they did before"


def good_trees(n):
    tree = PUBLISHED["CartPole-v1"][0]
    return Forest.of_parameters(tree, np.tile(tree.parameters, (n, 1)))


@pytest.mark.parametrize("n_trees", [1, 50])
def test_a_limit_of_steps_ends_a_call_at_the_same_step_on_any_number_of_threads(n_trees, opened):
    allowed, ends = 400_000, set()
    for threads in (1, 2, 3):
        backend = opened("CartPole-v1", threads)
        backend.limit = Limit(max_env_steps=allowed)
        with pytest.raises(LimitReachedError) as reached:
            # A million steps, were it not for the limit.
            backend.evaluate(good_trees(n_trees), np.arange(2000 // n_trees), "validation")
        assert reached.value.reason == "max_env_steps"
        with pytest.raises(LimitReachedError):
            backend.record(leaf(0), 0)
        with pytest.raises(LimitReachedError):
            backend.run_jobs([lambda own: own.observe([leaf(0)], 9, [np.random.default_rng(0)], "x")] * 2)
        ends.add(backend.steps.total())
    assert len(ends) == 1
    assert allowed <= ends.pop() <= 1.1 * allowed


@pytest.mark.parametrize("n_threads", [1, 2])
@pytest.mark.parametrize("allowed", [100, 700, 3000])
def test_a_small_limit_ends_an_episode_in_the_middle(allowed, n_threads, opened):
    backend = opened("CartPole-v1", n_threads)
    backend.limit = Limit(max_env_steps=allowed)
    with pytest.raises(LimitReachedError):
        # Each of 500 steps.
        backend.evaluate(good_trees(3), np.arange(3), "validation")
    assert allowed <= backend.steps.total() <= allowed + 1


def test_an_episode_may_end_with_the_last_step_that_is_allowed(opened):
    backend, forest, seeds = opened("CartPole-v1", 1), Forest.stack([leaf(1)]), np.arange(1)
    n_steps = backend.evaluate(forest, seeds, "test").env_steps
    backend.limit = Limit(max_env_steps=2 * n_steps)
    assert backend.evaluate(forest, seeds, "test").env_steps == n_steps
    backend.limit = Limit(max_env_steps=3 * n_steps - 1)
    with pytest.raises(LimitReachedError):
        backend.evaluate(forest, seeds, "test")


def test_what_trees_see_begins_only_where_there_is_room_for_it(opened):
    backend = opened("CartPole-v1", 1)
    backend.limit = Limit(max_env_steps=100)
    with pytest.raises(LimitReachedError):
        backend.observe([leaf(0)] * 2, 60, [np.random.default_rng(0)] * 2, "x")
    assert backend.steps.total() == 0
    assert backend.observe([leaf(0)], 60, [np.random.default_rng(0)], "x").shape == (1, 60, 4)


def test_what_stays_below_the_limit_is_not_disturbed_by_it(opened):
    free, limited = opened("CartPole-v1", 2), opened("CartPole-v1", 2)
    seeds = np.arange(10)
    expected = free.evaluate(good_trees(10), seeds, "test")
    limited.limit = Limit(max_env_steps=expected.env_steps)
    outcomes = limited.evaluate(good_trees(10), seeds, "test")
    np.testing.assert_array_equal(outcomes.returns, expected.returns)
    with pytest.raises(LimitReachedError):
        limited.evaluate(good_trees(1), seeds, "test")


@pytest.mark.usefixtures("own_clock")
@pytest.mark.parametrize("threads", [1, 2])
def test_a_limit_of_time_ends_a_long_call_and_signs_of_life_are_given_in_it(threads, opened):
    backend, beats = opened("Acrobot-v1", threads), []
    backend.evaluate(Forest.stack([leaf(1)]), np.arange(30), "warm-up")
    backend.on_steps = lambda n_steps: beats.append((time.perf_counter(), n_steps, threading.get_ident()))
    started = time.perf_counter()
    backend.limit = Limit(deadline=started + 1.5)
    with pytest.raises(LimitReachedError) as reached:
        # Half a minute and more: a free end that hangs, 500 million steps.
        backend.evaluate(Forest.stack([leaf(1)] * 100), np.arange(10_000), "validation")
    assert reached.value.reason == "max_seconds"
    assert time.perf_counter() - started < 1.5 * 1.1
    moments, steps, idents = map(list, zip(*beats, strict=True))
    assert max(np.diff([started, *moments])) < 1.0
    assert steps == sorted(steps)
    assert steps[-1] > 1_000_000
    assert set(idents) == {threading.get_ident()}


@pytest.mark.usefixtures("own_clock")
def test_jobs_too_hold_the_limit_of_time(opened):
    backend = opened("Acrobot-v1", 2)

    def endless(own):
        while True:
            own.evaluate(Forest.stack([leaf(1)]), np.arange(30), "polish")

    started = time.perf_counter()
    backend.limit = Limit(deadline=started + 0.3)
    with pytest.raises(LimitReachedError):
        backend.run_jobs([endless, endless, endless])
    assert time.perf_counter() - started < 1.0

    def broken(_):
        raise ValueError("a job broke")

    backend.limit = None
    with pytest.raises(ValueError, match="a job broke"):
        backend.run_jobs([broken, endless])
    assert backend.limit is None


@pytest.mark.usefixtures("own_clock")
@pytest.mark.parametrize("threads", [1, 2])
def test_what_a_sign_of_life_raises_ends_the_call(threads, opened):
    """So does Ctrl-C, which comes at any place of the calling thread."""
    backend = opened("Acrobot-v1", threads)

    def interrupt(n_steps):
        if n_steps > 0:
            raise KeyboardInterrupt

    backend.on_steps = interrupt
    started = time.perf_counter()
    with pytest.raises(KeyboardInterrupt):
        backend.evaluate(Forest.stack([leaf(1)] * 100), np.arange(10_000), "validation")
    backend.close()
    assert time.perf_counter() - started < 3.0


def test_the_limit_is_looked_at_between_blocks_of_many_episodes_and_blocks_say_the_same(opened, monkeypatch):
    backend, trees = opened("CartPole-v1", 2), Forest.stack([PUBLISHED["CartPole-v1"][0], leaf(1)])
    whole = backend.evaluate(trees, np.arange(100), "test", visits=True)
    monkeypatch.setattr(kernel_backend, "_EPISODES_PER_BLOCK", 30)
    starts, looks, dynamics = [], [], backend._dynamics

    def noted(seeds):
        starts.append(len(seeds))
        return dynamics.starts(seeds)

    monkeypatch.setattr(backend, "_dynamics", replace(dynamics, starts=noted))
    monkeypatch.setattr(backend.ledger, "check", lambda: looks.append(len(starts)))
    parts = backend.evaluate(trees, np.arange(100), "test", visits=True)
    np.testing.assert_array_equal(parts.returns, whole.returns)
    np.testing.assert_array_equal(parts.lengths, whole.lengths)
    np.testing.assert_array_equal(parts.leaf_visits, whole.leaf_visits)
    assert starts == [30, 30, 30, 10]
    assert {0, 1, 2, 3} <= set(looks), "before each block"


def test_a_thread_that_does_not_come_back_is_left_behind():
    ledger, block, begun = Ledger(), threading.Event(), threading.Event()
    threads = Threads(2, ledger)
    main = threading.get_ident()

    def task():
        if threading.get_ident() != main:
            begun.set()
            block.wait()
        else:
            begun.wait()
        return 1

    def interrupt(_):
        if begun.is_set():
            raise KeyboardInterrupt

    ledger.on_steps = interrupt
    with pytest.raises(KeyboardInterrupt):
        threads.run([Task(task)] * 2, "x")
    ledger.on_steps = lambda _: None
    threads.run([Task(lambda: 1)] * 3, "again")
    threads.close()
    assert ledger.steps["again"] == 3
    block.set()
