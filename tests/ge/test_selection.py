import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ge_torchrl.ge.selection import replace_parents, tournament

FITNESS = st.sampled_from([-math.inf, 0.0, 1.0, 1.5, 2.0, 3.0])


class Drawn:
    """A source of randomness whose draws the test has typed in."""

    def __init__(self, entrants):
        self.entrants = np.array(entrants)

    def integers(self, high, size):
        assert self.entrants.shape == size
        assert self.entrants.max() < high
        return self.entrants


def individuals(n):
    """Fitness and sizes of n individuals; one without a tree has no decision nodes."""
    fitness = st.lists(FITNESS, min_size=n, max_size=n).map(np.array)
    sizes = st.lists(st.integers(0, 3), min_size=n, max_size=n).map(np.array)
    return st.tuples(fitness, sizes).map(lambda pair: (pair[0], np.where(np.isinf(pair[0]), 0, pair[1])))


def is_better(one, other):
    """What the module says: fitter, or as fit and smaller."""
    (fitness, size), (other_fitness, other_size) = one, other
    return fitness > other_fitness or (fitness == other_fitness and size < other_size)


def in_order(population, offspring, parents):
    """The thesis' replacement: each offspring in turn replaces what stands in its parent's place if it is better."""
    place = list(zip(*population, strict=True))
    heirs = {}
    for index, (child, parent) in enumerate(zip(zip(*offspring, strict=True), parents, strict=True)):
        if is_better(child, place[parent]):
            place[parent], heirs[int(parent)] = child, index
    return heirs


def equal_sizes(fitness):
    return fitness, np.zeros(len(fitness), np.int64)


def test_the_fittest_entrant_wins_and_the_first_of_equals():
    fitness, sizes = equal_sizes(np.array([1.0, 5.0, 5.0, -math.inf]))
    entrants = [[0, 1], [2, 1], [1, 2], [3, 0], [3, 3]]
    assert tournament(fitness, sizes, 5, 2, Drawn(entrants)).tolist() == [1, 2, 1, 0, 3]


def test_of_equally_fit_entrants_the_smallest_wins_and_the_first_of_equals():
    fitness, sizes = np.array([5.0, 5.0, 4.0, 5.0]), np.array([7, 3, 1, 3])
    entrants = [[0, 1], [1, 0], [3, 1], [1, 3], [2, 0]]
    assert tournament(fitness, sizes, 5, 2, Drawn(entrants)).tolist() == [1, 1, 3, 1, 0]


def test_individuals_without_a_tree_are_small_and_win_nothing():
    fitness, sizes = np.array([-math.inf, -500.0]), np.array([0, 9])
    assert tournament(fitness, sizes, 1, 2, Drawn([[0, 1]])).tolist() == [1]
    slots, _ = replace_parents((fitness[1:], sizes[1:]), (fitness[:1], sizes[:1]), np.array([0]))
    assert slots.tolist() == []


def test_chances_follow_from_the_rank():
    # The individual of rank r (0 the worst) of P wins a tournament of n with (r + 1)^n / P^n - r^n / P^n.
    n_offspring = 30_000
    fitness, sizes = equal_sizes(np.array([2.0, 0.0, 1.0]))
    winners = tournament(fitness, sizes, n_offspring, 3, np.random.default_rng(0))
    assert winners.dtype == np.int64
    for individual, chance in [(1, 1 / 27), (2, 7 / 27), (0, 19 / 27)]:
        deviation = math.sqrt(n_offspring * chance * (1 - chance))
        assert abs((winners == individual).sum() - n_offspring * chance) <= 6 * deviation


def test_equally_good_means_equal_chances():
    winners = tournament(np.zeros(5), np.full(5, 3), 20_000, 4, np.random.default_rng(1))
    assert (abs(np.bincount(winners, minlength=5) - 4000) <= 6 * math.sqrt(20_000 * 0.2 * 0.8)).all()


def test_a_tournament_of_one_is_a_uniform_draw():
    winners = tournament(np.array([9.0, 0.0]), np.array([1, 2]), 10_000, 1, np.random.default_rng(2))
    assert abs(winners.sum() - 5000) <= 6 * 50


@given(individuals(6), st.integers(0, 9), st.integers(1, 4))
def test_no_entrant_is_better_than_the_winner_and_none_as_good_was_drawn_before_it(group, seed, size):
    winners = tournament(*group, 20, size, np.random.default_rng(seed))
    entrants = np.random.default_rng(seed).integers(6, size=(20, size))
    ranks = list(zip(*group, strict=True))
    for winner, drawn in zip(winners, entrants, strict=True):
        assert not any(is_better(ranks[one], ranks[winner]) for one in drawn)
        first = next(one for one in drawn if ranks[one] == ranks[winner])
        assert first == winner


@given(individuals(6), st.integers(0, 9))
def test_where_sizes_are_equal_the_fittest_entrant_wins(group, seed):
    fitness, _ = group
    winners = tournament(fitness, np.full(6, 3), 20, 3, np.random.default_rng(seed))
    entrants = np.random.default_rng(seed).integers(6, size=(20, 3))
    np.testing.assert_array_equal(winners, entrants[np.arange(20), np.argmax(fitness[entrants], axis=1)])


@given(individuals(4), individuals(8), st.lists(st.integers(0, 3), min_size=8, max_size=8))
def test_an_offspring_replaces_its_parent_if_it_is_better(population, offspring, parents):
    slots, heirs = replace_parents(population, offspring, np.array(parents))
    assert slots.tolist() == sorted(slots)
    assert dict(zip(slots.tolist(), heirs.tolist(), strict=True)) == in_order(population, offspring, parents)


@given(individuals(4), individuals(8), st.lists(st.integers(0, 3), min_size=8, max_size=8))
def test_where_sizes_are_equal_a_fitter_offspring_replaces_its_parent(population, offspring, parents):
    plain, children = equal_sizes(population[0]), equal_sizes(offspring[0])
    slots, heirs = replace_parents(plain, children, np.array(parents))
    for parent in range(4):
        of_parent = [index for index in range(8) if parents[index] == parent]
        best = max(of_parent, key=lambda index: (children[0][index], -index), default=None)
        is_fitter = best is not None and children[0][best] > plain[0][parent]
        assert heirs[slots == parent].tolist() == ([best] if is_fitter else [])


def test_the_best_offspring_of_a_parent_takes_its_place():
    fitness, sizes = np.array([1.0, 2.0, 3.0, 4.0]), np.array([3, 3, 3, 3])
    parents = np.array([0, 2, 0, 0, 3, 2])
    offspring = np.array([1.5, 3.0, 2.5, 2.5, 4.0, -math.inf])
    slots, heirs = replace_parents((fitness, sizes), (offspring, np.array([1, 4, 5, 2, 2, 0])), parents)
    assert slots.tolist() == [0, 3]
    assert heirs.tolist() == [3, 4]
