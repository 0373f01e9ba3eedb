import numpy as np
import pytest
from forests_for_tests import NO_TREE
from problems_for_tests import Analytic, config_of, leaf

from ge_torchrl.search.fitness import (
    WORST_FITNESS,
    archive_seeds,
    fitness_of,
    measure,
    training_seeds,
    validation_seeds,
)
from ge_torchrl.search.fitness import test_seeds as unseen_seeds
from ge_torchrl.seeding import EPISODE_SEEDS
from ge_torchrl.trees.forest import Forest


def test_fitness_is_the_mean_return_and_an_individual_without_a_tree_is_worst():
    returns = np.array([[1, 3], [np.nan, np.nan], [-4, -8]], float)
    assert fitness_of(returns, 0.0).tolist() == [2, WORST_FITNESS, -6]
    assert fitness_of(returns, 1.0).tolist() == [1, WORST_FITNESS, -8]


def test_a_penalty_on_the_spread_prefers_the_steadier_of_two_trees_with_equal_means():
    returns = np.array([[0, 20], [9, 11]], float)
    assert fitness_of(returns, 0.0).tolist() == [10, 10]
    assert fitness_of(returns, 0.5).tolist() == [5, 9.5]


def test_measuring_counts_its_steps_under_its_purpose():
    backend = Analytic(lambda tree: float(tree.action[0]), luck=1.0)
    forest = Forest.concatenate([Forest.stack([leaf(0), leaf(1)]), NO_TREE])
    seeds = np.arange(4)
    returns = backend.evaluate(forest, seeds, "before").returns
    fitness = measure(backend, forest, seeds, "some purpose", 0.5)
    np.testing.assert_array_equal(fitness, fitness_of(returns, 0.5))
    assert fitness[2] == WORST_FITNESS
    assert backend.steps == {"before": 80, "some purpose": 80}


@pytest.mark.parametrize(("mode", "same"), [("fixed", True), ("fresh", False), ("common", False)])
def test_training_episodes_of_the_three_modes_are_found_by_the_generation(mode, same):
    config = config_of(evaluation={"episodes": 5, "episode_seeds": mode})
    fourth, third, again = (training_seeds(config, generation) for generation in (4, 3, 4))
    assert len(fourth) == len(third) == 5
    assert np.array_equal(fourth, third) == same
    np.testing.assert_array_equal(fourth, again)


def test_what_trains_what_chooses_and_what_tests_share_no_episode():
    config = config_of(evaluation={"test_episodes": 40})
    for seeds, purpose, n_episodes in (
        (training_seeds(config, 1), "training", 3),
        (archive_seeds(config), "validation", 20),
        (validation_seeds(config), "validation", 30),
        (unseen_seeds(config), "test", 40),
    ):
        assert len(set(seeds.tolist())) == n_episodes
        assert all(seed in EPISODE_SEEDS[purpose] for seed in seeds.tolist())
    assert not set(archive_seeds(config).tolist()) & set(validation_seeds(config).tolist())
