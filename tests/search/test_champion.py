import numpy as np
import pytest

from ge_torchrl.environments.choose import open_route
from ge_torchrl.environments.spec import describe
from ge_torchrl.ge.mapping import Mapping
from ge_torchrl.search.champion import choose_champion
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest

leaf, split = DecisionTree.leaf, DecisionTree.split
# Good trees with one split that no state of an episode needs, and a poor tree that got lucky.
GOOD = split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1))
GOOD_WITH_DEAD_BRANCH = split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), split(0, 99.0, leaf(1), leaf(0)))
POOR = split(3, 0.0, leaf(0), leaf(1))
VALIDATION = np.arange(50)


@pytest.fixture(scope="module")
def route():
    route = open_route(describe("CartPole-v1"))
    yield route
    route.close()


def mapping_of(trees):
    """A mapping as `map_population` would give it; None is an individual without a tree."""
    forest = Forest.stack([tree for tree in trees if tree is not None])
    sizes = [0 if tree is None else tree.n_nodes for tree in trees]
    offsets = np.concatenate([[0], np.cumsum(sizes)])
    forest = Forest(
        offsets, forest.feature, forest.threshold, forest.children_left, forest.children_right, forest.action
    )
    return Mapping(
        forest=forest,
        codons_read=np.zeros(len(trees), np.int64),
        first_codon=np.zeros(len(forest.feature), np.int32),
        valid=np.array([tree is not None for tree in trees]),
    )


def test_a_lucky_leader_is_unmasked_by_validation(route):
    champion = choose_champion(route, mapping_of([POOR, GOOD]), np.array([500.0, 400.0]), 2, VALIDATION)
    assert champion.individual == 1
    assert champion.full == GOOD
    assert champion.train_fitness == 400
    assert champion.validation_mean > 490


def test_only_leaders_are_tested_again(route):
    champion = choose_champion(route, mapping_of([POOR, GOOD]), np.array([500.0, 400.0]), 1, VALIDATION)
    assert champion.individual == 0


def test_trees_that_act_alike_count_as_one_candidate(route):
    population = mapping_of([POOR, POOR, None, GOOD])
    champion = choose_champion(route, population, np.array([500.0, 500.0, -np.inf, 400.0]), 2, VALIDATION)
    assert champion.individual == 3


def test_the_champion_is_pruned_by_its_visits(route):
    champion = choose_champion(route, mapping_of([GOOD_WITH_DEAD_BRANCH]), np.array([500.0]), 5, VALIDATION)
    assert champion.full == GOOD_WITH_DEAD_BRANCH
    assert champion.pruned == GOOD


def test_of_equally_good_trees_the_smaller_is_taken(route):
    # Both always push left; the larger asks a question that does not matter.
    idle = split(0, 0.0, leaf(0), split(1, 0.0, leaf(0), split(1, 9.0, leaf(0), leaf(1))))
    champion = choose_champion(route, mapping_of([idle, leaf(0)]), np.array([9.0, 9.0]), 5, VALIDATION)
    assert champion.full == leaf(0)


def test_pruned_and_full_act_alike_on_every_validation_episode(route):
    """Law 7, on the episodes that counted the visits."""
    champion = choose_champion(route, mapping_of([GOOD_WITH_DEAD_BRANCH]), np.array([1.0]), 1, VALIDATION)
    outcomes = route.evaluate(Forest.stack([champion.full, champion.pruned]), VALIDATION)
    np.testing.assert_array_equal(outcomes.returns[0], outcomes.returns[1])
