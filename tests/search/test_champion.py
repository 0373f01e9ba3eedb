import numpy as np
import pytest

from ge_torchrl.environments.choose import open_route
from ge_torchrl.environments.spec import describe
from ge_torchrl.ge.mapping import Mapping
from ge_torchrl.search.champion import POPULATION, REFINEMENT, Contender, choose_champion, contenders_of
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


def choose(route, trees, fitness, n_candidates):
    contenders = [Contender(tree, value, POPULATION) for tree, value in zip(trees, fitness, strict=True)]
    return choose_champion(route, contenders, n_candidates, VALIDATION)


def test_contenders_are_the_valid_individuals_fittest_first():
    forest = Forest.stack([POOR, GOOD])
    mapping = Mapping(
        forest=Forest(np.array([0, 3, 3, 8]), *forest.arrays[1:]),
        codons_read=np.zeros(3, np.int64),
        first_codon=np.zeros(8, np.int32),
        valid=np.array([True, False, True]),
    )
    contenders = contenders_of(mapping, np.array([3.0, -np.inf, 5.0]))
    assert [(contender.tree, contender.fitness) for contender in contenders] == [(GOOD, 5.0), (POOR, 3.0)]
    assert {contender.origin for contender in contenders} == {POPULATION}


def test_a_lucky_leader_is_unmasked_by_validation(route):
    champion = choose(route, [POOR, GOOD], [500.0, 400.0], 2)
    assert champion.full == GOOD
    assert champion.train_fitness == 400
    assert champion.validation_mean > 490


def test_only_leaders_are_tested_again(route):
    assert choose(route, [POOR, GOOD], [500.0, 400.0], 1).full == POOR


def test_trees_that_act_alike_count_as_one_candidate(route):
    assert choose(route, [POOR, POOR, GOOD], [500.0, 500.0, 400.0], 2).full == GOOD


def test_the_champion_is_pruned_by_its_visits(route):
    champion = choose(route, [GOOD_WITH_DEAD_BRANCH], [500.0], 5)
    assert champion.full == GOOD_WITH_DEAD_BRANCH
    assert champion.pruned == GOOD


def test_of_equally_good_trees_the_smaller_is_taken(route):
    # Both always push left; the larger asks a question that does not matter.
    idle = split(0, 0.0, leaf(0), split(1, 0.0, leaf(0), split(1, 9.0, leaf(0), leaf(1))))
    champion = choose(route, [idle, leaf(0)], [9.0, 9.0], 5)
    assert champion.full == leaf(0)


def test_pruned_and_full_act_alike_on_every_validation_episode(route):
    """Law 7, on the episodes that counted the visits."""
    champion = choose(route, [GOOD_WITH_DEAD_BRANCH], [1.0], 1)
    outcomes = route.evaluate(Forest.stack([champion.full, champion.pruned]), VALIDATION)
    np.testing.assert_array_equal(outcomes.returns[0], outcomes.returns[1])


def test_a_refined_tree_can_be_the_champion(route):
    contenders = [Contender(POOR, 500.0, POPULATION), Contender(GOOD, 499.0, REFINEMENT)]
    champion = choose_champion(route, contenders, 2, VALIDATION)
    assert (champion.full, champion.origin, champion.train_fitness) == (GOOD, REFINEMENT, 499.0)
