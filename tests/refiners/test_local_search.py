"""Local search mends leaves, moves numbers, and keeps to its budget and to its seed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fake_backend import FakeBackend

from ge_torchrl.config import PolishConfig
from ge_torchrl.environments.backend import Limit, LimitReachedError
from ge_torchrl.refiners.local_search import LocalSearch, spread_of
from ge_torchrl.refiners.protocol import FIRST, Effort
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
BEST = split(0, 0.25, split(1, -30.0, leaf(0), leaf(1)), leaf(1))
WRONG_LEAVES = BEST.with_actions([1, 1, 0])
FAR = BEST.with_parameters([1.5, 40.0])
# The second feature spreads forty times as far as the first.
SPREAD = (0.5, 20.0)
CONFIG = PolishConfig(max_timesteps=20_000, episodes=3)
# Steps of the round with most trees: six by CMA-ES, three episodes, ten steps an episode.
LARGEST_ROUND = 6 * 3 * 10


def value(tree):
    """0 for the best tree, and less for one whose numbers or actions differ."""
    wrong = (tree.action != BEST.action).sum()
    # What is best for one number depends on the other: a narrow valley.
    first, second = (tree.parameters.astype(np.float64) - BEST.parameters) / SPREAD
    return -float(first**2 + 10 * (second - first) ** 2 + 5 * wrong)


def search(tree=FAR, seed=0, effort=FIRST, backend=None, **changes):
    backend = backend or FakeBackend(value, spread=SPREAD)
    searcher = LocalSearch(backend, replace(CONFIG, **changes), "polish")
    (refined,) = searcher.refine([tree], [np.random.default_rng(seed)], effort)
    return refined


def largest_move(refined, before=FAR):
    """In units of the features' spread."""
    return np.abs((refined.tree.parameters - before.parameters) / SPREAD).max()


def test_wrong_leaves_are_mended_and_the_splits_stay():
    refined = search(WRONG_LEAVES)
    assert refined.tree.action.tolist() == BEST.action.tolist()
    assert refined.tree.with_parameters(BEST.parameters) == BEST


def test_numbers_find_their_best_values():
    refined = search()
    assert value(refined.tree) > -1e-3
    assert refined.tree.structure == FAR.structure
    assert refined.training.failure is None


def test_of_many_actions_the_best_is_chosen_leaf_by_leaf():
    backend = FakeBackend(value, n_actions=4, spread=SPREAD)
    tree = BEST.with_actions([3, 3, 3])
    assert search(tree, backend=backend).tree.action.tolist() == BEST.action.tolist()
    assert backend.batches[:4] == [(1, 3), (3, 3), (3, 3), (3, 3)]


def test_the_same_seed_gives_the_same_tree_and_the_global_stream_is_untouched():
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    one, same, other = (search(seed=seed, moves=4) for seed in (1, 1, 2))
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002
    assert one.tree == same.tree
    assert one.training.timesteps == same.training.timesteps
    assert other.tree != one.tree


@pytest.mark.parametrize("moves", [0, 8])
@pytest.mark.parametrize("budget", [1000, 3000])
def test_the_budget_is_counted_in_steps_and_passed_by_one_round_at_most(budget, moves):
    backend = FakeBackend(value, spread=SPREAD)
    taken = search(backend=backend, max_timesteps=budget, moves=moves).training
    # A round of moves is eight trees of one episode and three of all.
    largest_round = LARGEST_ROUND if moves == 0 else 8 * 10 + 3 * 3 * 10
    assert budget <= taken.timesteps < budget + largest_round
    assert backend.steps == {"polish": taken.timesteps}
    assert taken.updates == len(backend.batches)


def test_a_budget_that_is_spent_at_once_changes_nothing():
    refined = search(max_timesteps=2)
    assert refined.tree == FAR
    assert refined.training.updates == 1


def test_a_lone_number_can_be_tuned_and_none_need_not():
    lone = FakeBackend(lambda tree: -((float(tree.threshold[0]) - 0.7) ** 2), spread=SPREAD)
    refined = search(split(0, 0.0, leaf(0), leaf(1)), backend=lone, max_timesteps=5000)
    assert refined.tree.threshold[0] == pytest.approx(0.7, abs=1e-3)
    none = FakeBackend(lambda tree: float(tree.action[0]), n_actions=3)
    assert search(leaf(0), backend=none).tree == leaf(2)
    assert none.batches == [(1, 3), (2, 3)]


def test_the_weights_of_a_split_are_numbers_too():
    def nearness(tree):
        return -float(np.square(tree.parameters - [0.5, 1.0, -2.0]).sum())

    tree = DecisionTree.weighted_split([0, 1], [1.0, 1.0], 0.0, leaf(0), leaf(1))
    refined = search(tree, backend=FakeBackend(nearness), moves=4)
    assert nearness(refined.tree) > -1e-3
    assert refined.tree.structure == tree.structure


def test_a_step_that_would_overflow_stays_a_number():
    backend = FakeBackend(lambda tree: float(tree.threshold[0]) / 1e38, spread=(5e37, 1.0))
    refined = search(split(0, 3e38, leaf(0), leaf(1)), backend=backend, moves=4, max_timesteps=3000)
    assert refined.tree.threshold[0] == np.finfo(np.float32).max


def test_the_spread_is_that_of_the_observations_and_1_where_it_tells_nothing():
    observations = np.array([[0.0, 3.0, np.inf], [2.0, 3.0, 0.0]], np.float32)
    np.testing.assert_array_equal(spread_of(observations), [1.0, 1.0, 1.0])
    np.testing.assert_array_equal(spread_of(np.array([[0.0], [4.0]], np.float32)), [2.0])


def test_a_larger_first_step_moves_numbers_farther():
    near, far = (search(max_timesteps=2000, first_step=step) for step in (1e-6, 1.0))
    assert largest_move(near) < 1e-3 < largest_move(far)


def test_an_effort_can_search_nearer_by():
    near, far = (search(max_timesteps=2000, effort=effort) for effort in (Effort(step=1e-6), FIRST))
    assert largest_move(near) < 1e-3 < largest_move(far)


def test_each_number_is_moved_by_itself_where_that_is_asked_for():
    """The first steps of CMA-ES are too short to bring the far numbers home; single moves have all lengths."""
    alone, with_moves = (search(max_timesteps=4000, first_step=1e-6, moves=moves) for moves in (0, 8))
    assert largest_move(alone) < 0.01
    assert largest_move(with_moves) > 0.1
    assert value(with_moves.tree) > value(alone.tree)


def test_every_tree_is_measured_on_so_many_episodes_times_the_factor():
    for effort, episodes in ((FIRST, 3), (Effort(factor=4), 12), (Effort(patience=4), 3)):
        backend = FakeBackend(value, spread=SPREAD)
        search(effort=effort, backend=backend)
        assert {batch[1] for batch in backend.batches} == {episodes}
        assert len(set(backend.episodes)) == 1, "always the same ones"


def test_moves_are_screened_on_the_first_quarter_of_the_episodes_and_three_of_them_measured_on_all():
    for episodes, effort, batches in (
        (8, FIRST, {(8, 2), (3, 8)}),
        (8, Effort(factor=2), {(8, 4), (3, 16)}),
        (3, FIRST, {(8, 3)}),
    ):
        backend = FakeBackend(value, spread=SPREAD)
        search(effort=effort, backend=backend, episodes=episodes, moves=8)
        # Those of one tree are the leaves', and the rounds of CMA-ES have six.
        assert {batch for batch in backend.batches if batch[0] not in (1, 6)} == batches
        first = min(backend.episodes, key=len)
        assert all(seeds[: len(first)] == first for seeds in backend.episodes)


def test_trees_refined_together_end_where_each_would_alone():
    trees = [WRONG_LEAVES, FAR, leaf(0)]
    streams = [np.random.default_rng([7, i]) for i in range(3)]
    backend = FakeBackend(lambda tree: value(tree) if tree.num_decision_nodes else 0.0, spread=SPREAD)
    together = LocalSearch(backend, CONFIG, "refinement").refine(trees, streams)
    for i, (tree, refined) in enumerate(zip(trees, together, strict=True)):
        (alone,) = LocalSearch(backend, CONFIG, "refinement").refine([tree], [np.random.default_rng([7, i])])
        assert (alone.tree, alone.training.timesteps) == (refined.tree, refined.training.timesteps)
    assert LocalSearch(backend, CONFIG, "refinement").refine([], []) == []


def test_a_factor_and_patience_multiply_the_budget():
    def taken(effort):
        return search(effort=effort, max_timesteps=1000).training

    once, thrice, patient = taken(FIRST), taken(Effort(factor=3)), taken(Effort(patience=3))
    assert 1000 <= once.timesteps < 2000
    assert min(thrice.timesteps, patient.timesteps) >= 3000
    assert patient.updates > 2 * once.updates, "on as many episodes, more trees"


def test_a_limit_that_is_reached_ends_the_search():
    backend = FakeBackend(value, spread=SPREAD)
    backend.limit = Limit(max_env_steps=1500)
    with pytest.raises(LimitReachedError, match="max_env_steps"):
        search(backend=backend)
    assert backend.steps["polish"] < 1500 + LARGEST_ROUND
