"""The rival of PPO mends leaves, moves thresholds, keeps to its budget and to its seed."""

from dataclasses import replace

import numpy as np
import pytest

from ge_torchrl.environments.choose import open_route
from ge_torchrl.environments.spec import describe
from ge_torchrl.refiner_section import CMAESConfig, RefinerConfig
from ge_torchrl.search.cmaes import CMAESRefiner, spread_of
from ge_torchrl.search.refinement import FIRST, IMPROVED, NOT_IMPROVED, Effort, refine
from ge_torchrl.trees.decision_tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
GOOD = split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1))
WRONG_LEAVES = split(2, 0.0154, split(3, 0.2290, leaf(1), leaf(1)), leaf(0))
# The first question is asked far from where the pole stands.
FAR_THRESHOLD = split(2, 0.12, split(3, 0.2290, leaf(0), leaf(1)), leaf(1))
CONFIG = CMAESConfig(max_timesteps=60_000)
MEASURED = RefinerConfig(name="rival", method="cmaes", measuring_episodes=50)


@pytest.fixture(scope="module")
def route():
    route = open_route(describe("CartPole-v1"), threads=1)
    yield route
    route.close()


def refined(route, tree, seed=0, **changes):
    return refine(CMAESRefiner(route, replace(CONFIG, **changes)), route, tree, MEASURED, seed, "a test")


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
        assert budget <= taken.timesteps <= budget + 8 * 5 * 500 + 500


def test_a_budget_that_is_spent_at_once_changes_nothing(route):
    refinement = refined(route, GOOD, max_timesteps=2)
    assert (refinement.tree, refinement.outcome) == (GOOD, NOT_IMPROVED)


def test_a_budget_in_seconds_replaces_that_in_steps(route):
    refinement = refined(route, WRONG_LEAVES, max_timesteps=2, max_seconds=0.5)
    assert refinement.tree != WRONG_LEAVES
    assert refinement.training.timesteps > 100


def test_a_lone_threshold_can_be_tuned(route):
    assert refined(route, split(2, 0.1, leaf(0), leaf(1)), max_timesteps=20_000).return_after > 0


def test_the_spread_is_that_of_the_observations_and_1_where_it_tells_nothing():
    observations = np.array([[0.0, 3.0, np.inf], [2.0, 3.0, 0.0]], np.float32)
    with np.errstate(invalid="ignore"):
        np.testing.assert_array_equal(spread_of(observations), [1.0, 1.0, 1.0])
    np.testing.assert_array_equal(spread_of(np.array([[0.0], [4.0]], np.float32)), [2.0])


def test_a_larger_first_step_moves_thresholds_farther(route):
    near, far = (refined(route, FAR_THRESHOLD, max_timesteps=20_000, first_step=step) for step in (1e-6, 1.0))
    assert near.largest_threshold_move < 1e-4 < far.largest_threshold_move


def test_each_threshold_is_moved_by_itself_where_that_is_asked_for(route):
    """The first steps of CMA-ES are too short to bring the far threshold home; single moves have all lengths."""
    alone, with_moves = (
        refined(route, FAR_THRESHOLD, max_timesteps=100_000, first_step=1e-6, moves=moves) for moves in (0, 8)
    )
    assert alone.largest_threshold_move < 1e-4
    assert with_moves.largest_threshold_move > 1e-2
    assert with_moves.return_after > alone.return_after


def test_moves_keep_to_the_budget_in_steps(route):
    for budget in (5_000, 30_000):
        taken = refined(route, FAR_THRESHOLD, max_timesteps=budget, moves=8, screening_episodes=2).training
        assert budget <= taken.timesteps <= budget + 11 * 5 * 500 + 500


def test_an_effort_can_search_nearer_by(route):
    near, far = (
        CMAESRefiner(route, CONFIG).tune([FAR_THRESHOLD], [np.random.default_rng(0)], effort)[0].tree
        for effort in (Effort(step=1e-6), FIRST)
    )
    assert np.abs(near.threshold - FAR_THRESHOLD.threshold).max() < 1e-4
    assert np.abs(far.threshold - FAR_THRESHOLD.threshold).max() > 1e-2


class NotingRoute:
    """A true route that notes the trees and episodes of each batch, and counts every step."""

    def __init__(self, route):
        self.route, self.spec, self.env_steps = route, route.spec, 0
        self.episodes, self.batches = set(), []

    def evaluate(self, forest, seeds):
        self.episodes.add(len(seeds))
        self.batches.append((len(forest), len(seeds)))
        outcomes = self.route.evaluate(forest, seeds)
        self.env_steps += outcomes.env_steps
        return outcomes

    def observe(self, tree, n_steps, rng):
        self.env_steps += n_steps
        return self.route.observe(tree, n_steps, rng)


def test_every_tree_is_measured_on_so_many_episodes_times_the_factor(route):
    for effort, episodes in ((FIRST, 3), (Effort(factor=4), 12), (Effort(patience=4), 3)):
        noting = NotingRoute(route)
        refiner = CMAESRefiner(noting, CMAESConfig(max_timesteps=3000, episodes=3))
        refiner.tune([FAR_THRESHOLD], [np.random.default_rng(0)], effort)
        assert noting.episodes == {episodes}


def test_moves_are_screened_on_the_first_episodes_and_three_of_them_measured_on_all(route):
    for screening, effort, batches in (
        (2, FIRST, {(8, 2), (3, 6)}),
        (2, Effort(factor=2), {(8, 4), (3, 12)}),
        (0, FIRST, {(8, 6)}),
        (6, FIRST, {(8, 6)}),
    ):
        noting = NotingRoute(route)
        config = CMAESConfig(max_timesteps=20_000, episodes=6, moves=8, screening_episodes=screening)
        (tuned,) = CMAESRefiner(noting, config).tune([FAR_THRESHOLD], [np.random.default_rng(0)], effort)
        assert tuned.env_steps == noting.env_steps
        # Those of one tree are the leaves', and the rounds of CMA-ES have six.
        assert {batch for batch in noting.batches if batch[0] not in (1, 6)} == batches


def test_trees_tuned_side_by_side_are_those_tuned_alone_on_the_same_episodes(route):
    trees = [WRONG_LEAVES, FAR_THRESHOLD]
    streams = [np.random.default_rng([7, i]) for i in range(2)]
    together = CMAESRefiner(route, CONFIG).tune(trees, streams)
    two_threads = open_route(describe("CartPole-v1"), threads=2)
    streams = [np.random.default_rng([7, i]) for i in range(2)]
    beside = CMAESRefiner(two_threads, CONFIG).tune(trees, streams)
    two_threads.close()
    assert [one.tree for one in together] == [one.tree for one in beside]
    assert [one.env_steps for one in together] == [one.env_steps for one in beside]
    (alone,) = CMAESRefiner(route, CONFIG).tune(trees[:1], [np.random.default_rng([7, 0])])
    assert alone.tree == together[0].tree
    assert CMAESRefiner(route, CONFIG).tune([], []) == []


def test_a_factor_multiplies_the_budget(route):
    (once,), (thrice,), (patient,) = (
        CMAESRefiner(route, CONFIG).tune([FAR_THRESHOLD], [np.random.default_rng(0)], effort)
        for effort in (FIRST, Effort(factor=3), Effort(patience=3))
    )
    assert once.env_steps < 2 * CONFIG.max_timesteps < 3 * CONFIG.max_timesteps <= thrice.env_steps
    assert patient.env_steps >= 3 * CONFIG.max_timesteps
    assert patient.training.updates > 2 * once.training.updates, "on as many episodes, more trees"
