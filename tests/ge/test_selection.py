import math

import numpy as np

from ge_torchrl.ge.selection import elite, replace_parents, tournament


class Drawn:
    """A source of randomness whose draws the test has typed in."""

    def __init__(self, entrants):
        self.entrants = np.array(entrants)

    def integers(self, high, size):
        assert self.entrants.shape == size
        assert self.entrants.max() < high
        return self.entrants


def test_the_fittest_entrant_wins_and_the_first_of_equals():
    fitness = np.array([1.0, 5.0, 5.0, -math.inf])
    entrants = [[0, 1], [2, 1], [1, 2], [3, 0], [3, 3]]
    assert tournament(fitness, 5, 2, Drawn(entrants)).tolist() == [1, 2, 1, 0, 3]


def test_chances_follow_from_the_rank():
    # The individual of rank r (0 the worst) of P wins a tournament of n with (r + 1)^n / P^n - r^n / P^n.
    n_offspring = 30_000
    winners = tournament(np.array([2.0, 0.0, 1.0]), n_offspring, 3, np.random.default_rng(0))
    assert winners.dtype == np.int64
    for individual, chance in [(1, 1 / 27), (2, 7 / 27), (0, 19 / 27)]:
        deviation = math.sqrt(n_offspring * chance * (1 - chance))
        assert abs((winners == individual).sum() - n_offspring * chance) <= 6 * deviation


def test_equal_fitness_means_equal_chances():
    counts = np.bincount(tournament(np.zeros(5), 20_000, 4, np.random.default_rng(1)), minlength=5)
    assert (abs(counts - 4000) <= 6 * math.sqrt(20_000 * 0.2 * 0.8)).all()


def test_a_tournament_of_one_is_a_uniform_draw():
    winners = tournament(np.array([9.0, 0.0]), 10_000, 1, np.random.default_rng(2))
    assert abs(winners.sum() - 5000) <= 6 * 50


def test_elite_is_ordered_and_ties_go_to_the_lower_index():
    fitness = np.array([1.0, 3.0, 2.0, 3.0, -math.inf])
    assert elite(fitness, 3).tolist() == [1, 3, 2]
    assert elite(fitness, 0).tolist() == []
    assert elite(fitness, 5).tolist() == [1, 3, 2, 0, 4]


def test_the_fittest_offspring_of_a_parent_takes_its_place():
    fitness = np.array([1.0, 2.0, 3.0, 4.0])
    parents = np.array([0, 2, 0, 0, 3, 2])
    offspring = np.array([1.5, 3.0, 2.5, 2.5, 5.0, -math.inf])
    slots, heirs = replace_parents(fitness, offspring, parents)
    assert slots.tolist() == [0, 3]
    assert heirs.tolist() == [2, 4]


def test_replacement_is_what_going_through_the_offspring_in_order_gives():
    rng = np.random.default_rng(0)
    for _ in range(200):
        fitness, offspring = rng.integers(4, size=6).astype(float), rng.integers(6, size=9).astype(float)
        parents = rng.integers(6, size=9)
        place = dict.fromkeys(range(6))
        current = fitness.copy()
        for index, parent in enumerate(parents):
            if offspring[index] > current[parent]:
                current[parent], place[parent] = offspring[index], index
        slots, heirs = replace_parents(fitness, offspring, parents)
        assert dict(zip(slots, heirs, strict=True)) == {p: i for p, i in place.items() if i is not None}
