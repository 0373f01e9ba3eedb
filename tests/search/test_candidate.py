"""Each rule of thesis section 3.3 by itself."""

import numpy as np
import pytest

from ge_torchrl.search.candidate import (
    Candidate,
    Eligibility,
    choose_candidate,
    choose_candidates,
    choose_of_each_size,
    in_turns,
)
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest

CARTPOLE = Eligibility(solved_at=475.0, lowest_fitness=None)
MOUNTAIN_CAR = Eligibility(solved_at=-110.0, lowest_fitness=-200.0)


class ScriptedRandom:
    """Draws what the test wrote down."""

    def __init__(self, first, draws):
        self.first, self.draws = first, list(draws)

    def random(self):
        return self.first

    def integers(self, n):
        assert n > 0
        return self.draws.pop(0)


def choose(fitness, n_nodes, eligibility, *, first, draws=()):
    rng = ScriptedRandom(first, draws)
    return choose_candidate(np.array(fitness, float), np.array(n_nodes), eligibility, 0.5, rng)


@pytest.mark.parametrize(
    ("eligibility", "n_nodes", "fitness", "admitted"),
    [
        (CARTPOLE, 5, 474.9, True),
        (CARTPOLE, 5, 475.0, False),  # (a) solves the task
        (CARTPOLE, 1, 9.0, False),  # (b) one leaf
        (CARTPOLE, 3, 200.0, False),  # (c) one condition and two leaves
        (CARTPOLE, 5, 9.0, True),
        (MOUNTAIN_CAR, 5, -200.0, False),  # (d) never saw a reward
        (MOUNTAIN_CAR, 5, -199.9, True),
        (MOUNTAIN_CAR, 5, -110.0, False),
        (MOUNTAIN_CAR, 0, -np.inf, False),  # no tree at all
        (Eligibility(None, None), 5, 1e9, True),
        (Eligibility(None, None, min_nodes=3), 5, 9.0, False),
        (Eligibility(None, None, min_nodes=3), 7, 9.0, True),
        (Eligibility(None, None, min_nodes=1), 3, 9.0, True),
        (Eligibility(None, None, min_nodes=1), 1, 9.0, False),
    ],
)
def test_rules_of_rejection(eligibility, n_nodes, fitness, admitted):
    assert eligibility.admits(n_nodes, fitness) == admitted


def test_the_first_draw_is_the_best_or_a_random_tree():
    assert choose([10, 300, 20], [5, 5, 5], CARTPOLE, first=0.49) == Candidate(1, "best", 0)
    assert choose([10, 300, 20], [5, 5, 5], CARTPOLE, first=0.5, draws=[2]) == Candidate(2, "random", 0)


def test_a_rejected_tree_is_redrawn_at_random_and_counted():
    # The best solves the task; of the redrawn ones the first is a leaf, the second will do.
    chosen = choose([500, 9, 30], [5, 1, 7], CARTPOLE, first=0.0, draws=[1, 2])
    assert chosen == Candidate(2, "best", 2)


def test_after_population_size_redraws_there_is_no_candidate():
    draws = [0, 1, 2, 0]
    rng = ScriptedRandom(0.9, draws)
    chosen = choose_candidate(np.array([500.0, 480.0, 475.0]), np.array([5, 5, 5]), CARTPOLE, 0.5, rng)
    assert chosen == Candidate(None, "random", 3)
    assert rng.draws == [], "the first draw and population size redraws were looked at"


def test_the_last_redraw_still_counts():
    assert choose([500, 9, 30], [5, 1, 7], CARTPOLE, first=0.0, draws=[0, 1, 2]) == Candidate(2, "best", 3)


def test_half_of_the_first_draws_are_the_best():
    rng = np.random.default_rng(0)
    chosen = [
        choose_candidate(np.arange(10.0), np.full(10, 5), CARTPOLE, 0.5, rng).chosen for _ in range(2000)
    ]
    assert abs(chosen.count("best") - 1000) <= 4 * np.sqrt(500)


@pytest.mark.parametrize(("n_candidates", "n_chosen"), [(1, 1), (2, 2), (24, 24), (30, 24)])
def test_further_candidates_are_random_different_and_admitted(n_candidates, n_chosen):
    # Of every five individuals the second (a leaf) and the last (it solves) are out.
    fitness, n_nodes = np.tile([10.0, 9.0, 30.0, 20.0, 500.0], 8), np.tile([5, 1, 5, 5, 5], 8)
    for seed in range(20):
        rng, same = np.random.default_rng(seed), np.random.default_rng(seed)
        chosen = choose_candidates(fitness, n_nodes, CARTPOLE, 0.5, n_candidates, rng)
        assert chosen[0] == choose_candidate(fitness, n_nodes, CARTPOLE, 0.5, same)
        individuals = [candidate.individual for candidate in chosen]
        assert len(set(individuals)) == len(individuals) == n_chosen
        assert {individual % 5 for individual in individuals} <= {0, 2, 3}


def test_where_nobody_is_admitted_there_is_one_candidate_without_an_individual():
    rng = np.random.default_rng(0)
    (chosen,) = choose_candidates(np.array([9.0, 9.0]), np.array([1, 1]), CARTPOLE, 0.5, 3, rng)
    assert chosen.individual is None


def comb(*features, threshold=0.5):
    """Return a tree with a decision on each feature, one below the other on the right."""
    tree = DecisionTree.leaf(1)
    for feature in reversed(features):
        tree = DecisionTree.split(feature, threshold, DecisionTree.leaf(0), tree)
    return tree


def individuals_chosen(trees, fitness, n_candidates, times_refined, eligibility=CARTPOLE):
    chosen = choose_of_each_size(
        np.array(fitness, float), Forest.stack(trees), eligibility, n_candidates, times_refined
    )
    assert all(candidate.chosen == "fittest" for candidate in chosen)
    return [candidate.individual for candidate in chosen]


class TestOfEachSize:
    # Sizes 2, 2, 2, 3, 3, 4, and one that is too small; the first two are of one structure.
    TREES = (
        comb(0, 1),
        comb(0, 1, threshold=0.7),
        comb(1, 0),
        comb(0, 1, 2),
        comb(2, 1, 0),
        comb(0, 0, 0, 0),
        comb(3),
    )
    FITNESS = (50, 60, 55, 20, 30, 10, 70)

    def test_the_fittest_of_every_size_goes_first_and_alike_trees_go_once(self):
        assert individuals_chosen(self.TREES, self.FITNESS, 3, {}) == [1, 4, 5]
        assert individuals_chosen(self.TREES, self.FITNESS, 9, {}) == [1, 4, 5, 2, 3]

    def test_structures_seldom_refined_go_before_the_fittest(self):
        refined = {self.TREES[0].structure: 2, self.TREES[4].structure: 1}
        assert individuals_chosen(self.TREES, self.FITNESS, 9, refined) == [5, 2, 3, 4, 1]

    def test_who_may_not_be_refined_is_left_out(self):
        hopeless_or_solved = Eligibility(solved_at=60.0, lowest_fitness=20.0)
        chosen = individuals_chosen(self.TREES, self.FITNESS, 9, {}, hopeless_or_solved)
        # Without the second tree the first speaks for their structure.
        assert chosen == [2, 4, 0]

    def test_where_nobody_is_admitted_there_is_one_candidate_without_an_individual(self):
        assert individuals_chosen([comb(3)], [10], 3, {}) == [None]


def test_the_fittest_of_every_size_come_first_then_the_second():
    fitness = np.array([5.0, 9.0, 1.0, 7.0, 3.0])
    sizes = np.array([1, 2, 1, 2, 3])
    assert in_turns(fitness, sizes).tolist() == [1, 0, 4, 3, 2]
