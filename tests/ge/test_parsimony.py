import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ge_torchrl.ge.parsimony import elite_lean, is_better, replace_parents_lean, tournament_lean
from ge_torchrl.ge.selection import elite, replace_parents, tournament

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
    return st.tuples(
        st.lists(FITNESS, min_size=n, max_size=n).map(np.array),
        st.lists(st.integers(0, 3), min_size=n, max_size=n).map(np.array),
    )


def test_of_equally_fit_entrants_the_smallest_wins_and_the_first_of_equals():
    fitness, sizes = np.array([5.0, 5.0, 4.0, 5.0]), np.array([7, 3, 1, 3])
    entrants = [[0, 1], [1, 0], [3, 1], [1, 3], [2, 0]]
    assert tournament_lean(fitness, sizes, 0.0, 5, 2, Drawn(entrants)).tolist() == [1, 1, 3, 1, 0]


def test_tolerance_lets_a_little_fitness_be_given_for_size():
    fitness, sizes = np.array([5.0, 4.0, 3.0]), np.array([7, 3, 1])
    for tolerance, winner in [(0.9, 0), (1.0, 1), (2.0, 2)]:
        assert tournament_lean(fitness, sizes, tolerance, 1, 3, Drawn([[0, 1, 2]])).tolist() == [winner]


def test_individuals_without_a_tree_are_small_and_win_nothing():
    fitness, sizes = np.array([-math.inf, -500.0]), np.array([0, 9])
    assert tournament_lean(fitness, sizes, 10.0, 1, 2, Drawn([[0, 1]])).tolist() == [1]
    slots, _ = replace_parents_lean((fitness[1:], sizes[1:]), (fitness[:1], sizes[:1]), 10.0, np.array([0]))
    assert slots.tolist() == []


def test_an_equally_fit_smaller_offspring_takes_its_parents_place_and_a_larger_does_not():
    population = (np.array([1.0, 1.0, 1.0]), np.array([5, 5, 5]))
    offspring = (np.array([1.0, 1.0, 0.5]), np.array([4, 6, 1]))
    parents = np.arange(3)
    assert [index.tolist() for index in replace_parents_lean(population, offspring, 0.0, parents)] == [
        [0],
        [0],
    ]
    assert replace_parents_lean(population, offspring, 0.5, parents)[0].tolist() == [0, 2]


def test_elite_takes_the_smaller_of_equally_fit_ones():
    assert elite_lean(np.array([3.0, 1.0, 3.0, 3.0]), np.array([2, 0, 1, 1]), 3).tolist() == [2, 3, 0]


@given(individuals(6), individuals(8), st.lists(st.integers(0, 5), min_size=8, max_size=8), st.integers(0, 9))
def test_where_sizes_are_equal_it_is_selection_by_fitness(population, offspring, parents, seed):
    fitness, children, parents = population[0], offspring[0], np.array(parents)
    same, same_children = np.full(6, 3), np.full(8, 3)
    draws = (np.random.default_rng(seed) for _ in range(2))
    one = tournament_lean(fitness, same, 0.0, 20, 3, next(draws))
    np.testing.assert_array_equal(one, tournament(fitness, 20, 3, next(draws)))
    np.testing.assert_array_equal(elite_lean(fitness, same, 4), elite(fitness, 4))
    lean = replace_parents_lean((fitness, same), (children, same_children), 0.0, parents)
    for ours, plain in zip(lean, replace_parents(fitness, children, parents), strict=True):
        np.testing.assert_array_equal(ours, plain)


@given(
    individuals(4),
    individuals(8),
    st.lists(st.integers(0, 3), min_size=8, max_size=8),
    st.sampled_from([0.0, 0.5, 1.0]),
)
def test_an_heir_is_better_than_its_parent_and_wins_the_tournament_of_its_siblings(
    population, offspring, parents, tolerance
):
    parents = np.array(parents)
    slots, heirs = replace_parents_lean(population, offspring, tolerance, parents)
    replaced = dict(zip(slots.tolist(), heirs.tolist(), strict=True))
    for parent in range(4):
        siblings = np.flatnonzero(parents == parent)
        than = tuple(np.repeat(values[parent], len(siblings)) for values in population)
        better = siblings[is_better(offspring[0][siblings], offspring[1][siblings], than, tolerance)]
        if len(better) == 0:
            assert parent not in replaced
            continue
        winner = tournament_lean(*offspring, tolerance, 1, len(better), Drawn([better.tolist()]))
        assert replaced[parent] == winner[0]


@given(individuals(2), st.sampled_from([0.0, 0.5, 1.0]))
def test_two_individuals_are_never_each_better_than_the_other(pair, tolerance):
    (one, other), (size, other_size) = (np.split(values, 2) for values in pair)
    forth = is_better(one, size, (other, other_size), tolerance)
    back = is_better(other, other_size, (one, size), tolerance)
    assert not (forth & back).any()
