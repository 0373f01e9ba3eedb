import numpy as np
import pytest

from ge_torchrl.environments.route import Outcomes
from ge_torchrl.search.fitness import WORST_FITNESS, TrainingEpisodes, measure
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest


class ScriptedRoute:
    """Returns what the test wrote down."""

    def __init__(self, returns, lengths):
        self.outcomes = Outcomes(np.array(returns, float), np.array(lengths))

    def evaluate(self, forest, seeds):  # noqa: ARG002
        return self.outcomes


def test_fitness_is_the_mean_return_and_an_individual_without_a_tree_is_worst():
    leaves = Forest.stack([DecisionTree.leaf(0), DecisionTree.leaf(1)])
    forest = Forest(
        np.array([0, 1, 1, 2]),
        leaves.feature,
        leaves.threshold,
        leaves.children_left,
        leaves.children_right,
        leaves.action,
    )
    route = ScriptedRoute([[1, 3], [np.nan, np.nan], [-4, -8]], [[1, 3], [0, 0], [4, 8]])
    measured = measure(route, forest, np.array([0, 1]))
    assert measured.fitness.tolist() == [2, WORST_FITNESS, -6]
    assert measured.env_steps == 16


@pytest.mark.parametrize(
    ("mode", "same", "remeasures"), [("fixed", True, False), ("fresh", False, False), ("common", False, True)]
)
def test_training_episodes_of_the_three_modes(mode, same, remeasures):
    episodes = TrainingEpisodes(mode, 5, np.random.default_rng(0))
    first, second = episodes.next_generation(), episodes.next_generation()
    assert len(first) == len(second) == 5
    assert np.array_equal(first, second) == same
    assert episodes.remeasures_parents == remeasures


def test_a_penalty_on_the_spread_prefers_the_steadier_of_two_trees_with_equal_means():
    forest = Forest.stack([DecisionTree.leaf(0), DecisionTree.leaf(1)])
    route = ScriptedRoute([[0, 20], [9, 11]], [[1, 1], [1, 1]])
    assert measure(route, forest, np.array([0, 1])).fitness.tolist() == [10, 10]
    assert measure(route, forest, np.array([0, 1]), 0.5).fitness.tolist() == [5, 9.5]


def test_an_individual_without_a_tree_is_worst_under_a_penalty_too():
    forest = Forest.stack([DecisionTree.leaf(0)])
    nobody = Forest(np.array([0, 0]), *(array[:0] for array in forest.arrays[1:]))
    route = ScriptedRoute([[np.nan, np.nan]], [[0, 0]])
    assert measure(route, nobody, np.array([0, 1]), 1.0).fitness.tolist() == [WORST_FITNESS]
