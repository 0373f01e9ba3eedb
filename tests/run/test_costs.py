"""A limit and what is refined within it."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
from problems_for_tests import config_of, leaf

from ge_torchrl.environments.backend import Accountable, Limit
from ge_torchrl.refiners.protocol import Effort, Refined, TrainingRecord
from ge_torchrl.run.costs import Cost, Rationed, measuring_cost, training_cost

# 1000 steps of training, two snapshots of 5 episodes; 4 + 15 + 3 episodes of acceptance and measuring.
CONFIG = config_of(
    evaluation={"episodes": 3},
    refiner={
        "acceptance_episodes": 2,
        "measuring_episodes": 5,
        "ppo": {"max_timesteps": 1000, "update_timesteps": 500, "snapshot_episodes": 5},
    },
).resolved(10_000)


class Counting:
    """Refines nothing, at so many steps a tree."""

    def __init__(self, ledger, steps=0):
        self.ledger, self.steps, self.asked = ledger, steps, []

    def refine(self, trees, _rngs, effort):
        self.asked.append(len(trees))
        self.ledger.count("refinement", len(trees) * self.steps * effort.factor * effort.patience)
        return [Refined(tree, TrainingRecord()) for tree in trees]


class Backend(Accountable):
    spec = SimpleNamespace(max_episode_steps=100)


@pytest.fixture
def rationed():
    backend = Backend()
    return Rationed(Counting(backend.ledger, 500), backend, CONFIG), backend


def refined(refiner, n, effort=None):
    some = refiner.refine([leaf(0)] * n, [np.random.default_rng(0)] * n, *([effort] if effort else []))
    assert len(some) == n
    return [one.training is not None for one in some]


def test_costs_are_guessed_from_the_configuration():
    assert training_cost(CONFIG, 100) == Cost(pytest.approx(0.29), 1500)
    assert measuring_cost(CONFIG, 100) == Cost(pytest.approx(0.11), 1100)


def test_without_a_limit_all_are_refined(rationed):
    refiner, _ = rationed
    assert refined(refiner, 50) == [True] * 50


def test_no_more_are_begun_than_the_steps_allow(rationed):
    refiner, backend = rationed
    # 2600 steps are guessed for each of four trees, and a fifth is kept free.
    backend.limit = Limit(max_env_steps=13_100)
    assert refined(refiner, 6) == [True] * 4 + [False] * 2
    # They took 500 each, and the guess stays: what a run does follows from the steps that are left.
    assert backend.ledger.steps_left == 11_100
    assert refined(refiner, 6, Effort(patience=5)) == [True] + [False] * 5
    assert backend.ledger.steps_left == 8_600
    assert refined(refiner, 6) == [True] * 2 + [False] * 4
    backend.limit = Limit(max_env_steps=1)
    assert refined(refiner, 6) == [False] * 6


def test_no_more_are_begun_than_the_time_allows(rationed):
    refiner, backend = rationed
    # Loading takes five seconds, and 0.4 are guessed for each tree.
    backend.limit = Limit(deadline=time.perf_counter() + 4.9)
    assert not any(refined(refiner, 100))
    backend.limit = Limit(deadline=time.perf_counter() + 5 + 10 * 0.4 / 0.8)
    assert 5 <= sum(refined(refiner, 100)) <= 10


def test_without_refined_trees_nothing_is_asked_of_the_refiner(rationed):
    refiner, backend = rationed
    backend.limit = Limit(max_env_steps=1)
    refined(refiner, 3)
    assert refiner._refiner.asked == []


def test_a_tree_of_a_large_batch_is_trained_in_a_fraction_of_a_second():
    fast = config_of(refiner={"ppo": {"max_timesteps": 40_000}}).resolved(1e8)
    assert 0.1 < training_cost(fast, 500).seconds < 0.6
