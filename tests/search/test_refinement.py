"""One refinement, whatever the method: what is accepted, what is measured, what is told."""

import numpy as np
import pytest

from ge_torchrl.environments.choose import open_route
from ge_torchrl.environments.spec import describe
from ge_torchrl.records import TrainingRecord
from ge_torchrl.refiner_section import RefinerConfig
from ge_torchrl.search.refinement import (
    FAILED,
    FIRST,
    IMPROVED,
    NOT_IMPROVED,
    Tuned,
    is_clearly_better,
    refine,
    stream_name,
)
from ge_torchrl.trees.decision_tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
GOOD = split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1))
BAD = split(2, 0.0, split(3, 0.2290, leaf(1), leaf(0)), leaf(0))


class Answers:
    """Answers with a tree, whatever the question."""

    def __init__(self, tree, failure=None):
        self.tree, self.failure = tree, failure

    def tune(self, trees, rngs, effort=FIRST):  # noqa: ARG002
        return [Tuned(self.tree, TrainingRecord(failure=self.failure), 7) for _ in trees]


@pytest.fixture(scope="module")
def route():
    route = open_route(describe("CartPole-v1"), threads=1)
    yield route
    route.close()


def test_better_by_so_many_standard_errors():
    # Differences 0, 2, 0, 2: mean 1, deviation 1, standard error 1/2.
    returns, than = np.array([1.0, 3.0, 1.0, 3.0]), np.ones(4)
    assert is_clearly_better(returns, than, 0.0)
    assert is_clearly_better(returns, than, 1.9)
    assert not is_clearly_better(returns, than, 2.0)
    assert not is_clearly_better(than, than, 0.0), "equal is not better"
    assert not is_clearly_better(than, returns, 0.0)


@pytest.mark.parametrize(
    ("before", "answer", "episodes", "after", "outcome"),
    [
        (BAD, GOOD, 0, GOOD, IMPROVED),
        (BAD, GOOD, 30, GOOD, IMPROVED),
        (GOOD, BAD, 0, BAD, NOT_IMPROVED),
        (GOOD, BAD, 30, GOOD, NOT_IMPROVED),
        (GOOD, GOOD, 30, GOOD, NOT_IMPROVED),
    ],
)
def test_what_is_not_better_comes_back_as_it_was_where_acceptance_asks(
    route, before, answer, episodes, after, outcome
):
    config = RefinerConfig(
        name="test", acceptance_episodes=episodes, acceptance_errors=2.0, measuring_episodes=10
    )
    refinement = refine(Answers(answer), route, before, config, 0, "test")
    assert (refinement.tree, refinement.outcome) == (after, outcome)
    assert (refinement.return_before == refinement.return_after) == (after == before)
    moved = np.count_nonzero(after.threshold != before.threshold)
    assert refinement.thresholds_moved == moved
    assert refinement.env_steps > 7


class NotingRoute:
    """A true route that notes the episodes of each batch."""

    def __init__(self, route):
        self.route, self.spec, self.seeds = route, route.spec, []

    def evaluate(self, forest, seeds):
        self.seeds.append(seeds.tolist())
        return self.route.evaluate(forest, seeds)


def test_so_many_episodes_accept_and_others_measure(route):
    noting = NotingRoute(route)
    config = RefinerConfig(name="test", acceptance_episodes=30, measuring_episodes=10)
    refinement = refine(Answers(GOOD), noting, BAD, config, 0, "test")
    accepting, measuring = noting.seeds
    assert (len(accepting), len(measuring)) == (30, 10)
    assert not set(accepting) & set(measuring)
    assert refinement.measuring_seeds.tolist() == measuring
    refine(Answers(BAD), noting, BAD, config, 0, "test")
    assert len(noting.seeds) == 3, "a tree that did not change is not asked whether it is better"


def test_more_errors_than_any_gain_accept_nothing(route):
    config = RefinerConfig(name="test", acceptance_episodes=30, acceptance_errors=1e6, measuring_episodes=5)
    assert refine(Answers(GOOD), route, BAD, config, 0, "test").tree == BAD


def test_a_failed_training_is_told(route):
    config = RefinerConfig(name="test", measuring_episodes=5)
    refinement = refine(Answers(BAD, failure="the loss is not finite"), route, BAD, config, 0, "test")
    assert (refinement.outcome, refinement.is_improved) == (FAILED, False)


def test_the_first_refinement_of_a_generation_is_named_as_if_it_were_the_only_one():
    assert stream_name(40, 0) == "refinement in generation 40"
    assert stream_name(40, 2) == "refinement in generation 40, attempt 2"
