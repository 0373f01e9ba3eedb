"""Races: clear winners win, what is worse costs little, and equal trees are told apart by their nodes."""

import numpy as np
import pytest
from problems_for_tests import GOOD, GOOD_WITH_DEAD_BRANCH, Analytic, comb, problem_of

from ge_torchrl.environments.backend import Outcomes
from ge_torchrl.search.racing import RACES, race, standard_errors

PARENT = comb(2, 3)


def raced(value, trees, luck=0.0, parent=PARENT, seed=0):
    backend = Analytic(value, luck=luck)
    return race(problem_of(backend), parent, trees, np.random.default_rng(seed)), backend


class Noisy(Analytic):
    """Whose trees have luck of their own: a failure that costs 300 in every sixth episode."""

    def evaluate(self, forest, seeds, purpose, *, visits=False):
        outcomes = super().evaluate(forest, seeds, purpose, visits=visits)
        rng = np.random.default_rng(int(seeds[0]))
        return Outcomes(
            outcomes.returns - 300.0 * (rng.random(outcomes.returns.shape) < 1 / 6), outcomes.lengths
        )


class TestRace:
    def test_who_is_better_in_every_episode_wins_on_few_of_them(self):
        better = comb(2, 3, threshold=0.2)
        found, backend = raced(
            lambda tree: float(tree.threshold.sum()), [comb(3, 2, threshold=-1.0), better], 5.0
        )
        assert found.winner == better
        assert len(found.parent_returns) == len(found.winner_returns) == 10
        assert set(backend.purposes) == {RACES}

    def test_who_is_worse_drops_out_after_the_first_round(self):
        worse = [comb(2, 3, threshold=-0.1 * i) for i in range(1, 6)]
        found, backend = raced(lambda tree: float(tree.threshold.sum()), worse)
        assert found.winner is None
        assert backend.batches == [(6, 5)]

    def test_of_equal_trees_the_smaller_one_wins_and_the_larger_one_does_not(self):
        found, _ = raced(lambda _: 1.0, [comb(2)], luck=5.0)
        assert found.winner == comb(2)
        found, _ = raced(lambda _: 1.0, [comb(2, 3, 2)], luck=5.0)
        assert found.winner is None

    def test_luck_alone_hardly_ever_wins(self):
        """Of 20 races of 24 trees each, which all do the same, two at the most have a winner."""
        trees = [comb(2, 3, threshold=0.01 * i) for i in range(1, 25)]
        won = 0
        for seed in range(20):
            problem = problem_of(Noisy(lambda _: 200.0))
            won += race(problem, PARENT, trees, np.random.default_rng(seed)).winner is not None
        assert won <= 2

    def test_a_difference_under_heavy_tails_is_found(self):
        """Of 10 races most are won by the only tree that is better."""
        better = comb(2, 3, threshold=0.5)
        trees = [*(comb(2, 3, threshold=0.01 * i) for i in range(1, 6)), better]
        won = 0
        for seed in range(10):
            problem = problem_of(Noisy(lambda tree: 260.0 if tree == better else 100.0))
            won += race(problem, PARENT, trees, np.random.default_rng(seed)).winner == better
        assert won >= 7

    def test_nobody_races_for_nothing(self):
        found, backend = raced(lambda _: 1.0, [])
        assert found.winner is None
        assert backend.batches == []

    def test_what_a_spread_costs_counts(self):
        trees = [GOOD]
        backend = Analytic(lambda tree: 1.0 if tree == GOOD else 0.0, luck=1.0)
        problem = problem_of(backend, evaluation={"std_penalty": 1.0})
        assert race(problem, GOOD_WITH_DEAD_BRANCH, trees, np.random.default_rng(0)).winner == GOOD


@pytest.mark.parametrize(
    ("gained", "errors"),
    [([0.0, 0.0], 0.0), ([1.0, 1.0], np.inf), ([-1.0, -1.0], -np.inf), ([0.0, 2.0], np.sqrt(2))],
)
def test_standard_errors(gained, errors):
    np.testing.assert_allclose(standard_errors(np.array([gained])), [errors])
