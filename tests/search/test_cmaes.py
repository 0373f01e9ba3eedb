"""The rival of PPO mends leaves, moves thresholds, keeps to its budget and to its seed."""

from dataclasses import replace

import numpy as np
import pytest
from ge_torchrl.refinement_section import PPOConfig

from ge_torchrl.environments.choose import open_route
from ge_torchrl.environments.spec import describe
from ge_torchrl.search.cmaes import CMAESRefiner, visited_spread
from ge_torchrl.search.refinement import IMPROVED, NOT_IMPROVED
from ge_torchrl.trees.decision_tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
GOOD = split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1))
WRONG_LEAVES = split(2, 0.0154, split(3, 0.2290, leaf(1), leaf(1)), leaf(0))
# The first question is asked far from where the pole stands.
FAR_THRESHOLD = split(2, 0.12, split(3, 0.2290, leaf(0), leaf(1)), leaf(1))
CONFIG = PPOConfig(name="rival", method="cmaes", max_timesteps=60_000, measuring_episodes=50)


@pytest.fixture(scope="module")
def route():
    route = open_route(describe("CartPole-v1"), threads=1)
    yield route
    route.close()


def refined(route, tree, seed=0, **changes):
    return CMAESRefiner(route, replace(CONFIG, **changes), seed).refine(tree, generation=40)


def test_wrong_leaves_are_mended_and_the_structure_stays(route):
    refinement = refined(route, WRONG_LEAVES)
    assert refinement.outcome == IMPROVED
    assert refinement.leaves_changed > 0
    assert refinement.return_after > 5 * refinement.return_before
    np.testing.assert_array_equal(refinement.tree.feature, WRONG_LEAVES.feature)
    np.testing.assert_array_equal(refinement.tree.children_left, WRONG_LEAVES.children_left)


def test_a_far_threshold_is_moved(route):
    refinement = refined(route, FAR_THRESHOLD, max_timesteps=300_000)
    assert refinement.outcome == IMPROVED
    assert refinement.thresholds_moved > 0


def test_the_same_seed_gives_the_same_tree_and_the_global_stream_is_untouched(route):
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    one, same, other = (refined(route, FAR_THRESHOLD, seed, max_timesteps=200_000) for seed in (1, 1, 2))
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002
    assert one.tree == same.tree
    assert (one.return_after, one.env_steps) == (same.return_after, same.env_steps)
    assert other.tree != one.tree


def test_the_budget_is_counted_in_steps_and_passed_by_one_round_at_most(route):
    # The probe for the spread, and a round of at most 8 trees of 5 episodes of 500 steps.
    for budget in (5_000, 30_000):
        taken = refined(route, FAR_THRESHOLD, max_timesteps=budget).training
        assert budget <= taken.timesteps <= budget + 8 * 5 * 500 + 1000


def test_a_budget_that_is_spent_at_once_changes_nothing(route):
    refinement = refined(route, GOOD, max_timesteps=2, update_timesteps=2)
    assert (refinement.tree, refinement.outcome) == (GOOD, NOT_IMPROVED)


def test_a_budget_in_seconds_replaces_that_in_steps(route):
    refinement = refined(route, WRONG_LEAVES, max_timesteps=2, update_timesteps=2, cmaes_seconds=0.5)
    assert refinement.tree != WRONG_LEAVES
    assert refinement.training.timesteps > 100


def test_a_lone_threshold_can_be_tuned(route):
    assert refined(route, split(2, 0.1, leaf(0), leaf(1)), max_timesteps=20_000).return_after > 0


def test_the_spread_is_that_of_the_states_that_the_tree_visits():
    spread = visited_spread(describe("CartPole-v1"), GOOD, seed=0)
    assert spread.shape == (4,)
    assert spread[2] < 0.1 < spread[3], "the pole stays upright and swings"
