"""Selection: who has offspring, and who makes room for it. A higher fitness is better; none may be NaN."""

import numpy as np
from numpy.typing import NDArray

Fitness = NDArray[np.float64]


def tournament(
    fitness: Fitness, n_offspring: int, tournament_size: int, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Select parents by tournaments: the fittest of `tournament_size` individuals drawn with replacement.

    Of equally fit ones the one drawn first wins, so that equal fitness means equal chances.

    Args:
        fitness: [P] float64.
        n_offspring: Number of parents to select.
        tournament_size: Number of individuals in a tournament, at least 1.
        rng: Source of randomness.

    Returns:
        [n_offspring] int64, indices of the parents.

    Source:
        D. E. Goldberg and K. Deb, "A comparative analysis of selection schemes used in genetic algorithms",
        Foundations of Genetic Algorithms 1, 1991.
    """
    entrants = rng.integers(len(fitness), size=(n_offspring, tournament_size))
    winners = np.argmax(fitness[entrants], axis=1)
    parents: NDArray[np.int64] = entrants[np.arange(n_offspring), winners]
    return parents


def elite(fitness: Fitness, n_elite: int) -> NDArray[np.int64]:
    """Return the fittest individuals, best first; of equally fit ones the lower index comes first.

    Args:
        fitness: [P] float64.
        n_elite: Number of individuals, at most P.

    Returns:
        [n_elite] int64, their indices.
    """
    return np.argsort(-fitness, kind="stable")[:n_elite]


def replace_parents(
    fitness: Fitness, offspring_fitness: Fitness, parents: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Decide which offspring take their parents' places: one takes its parent's if it is strictly fitter.

    Individuals that were no parents stay. Of several fitter offspring of one parent the fittest takes its place, of
    equally fit ones the first: what one gets by going through the offspring in order, as section 1.3 of the thesis
    tells it.

    Args:
        fitness: [P] float64, of the population.
        offspring_fitness: [O] float64, of the offspring.
        parents: [O] int64, the index in the population of each offspring's parent.

    Returns:
        The indices [R] of the replaced and of the offspring that take their places, in the order of the replaced.
    """
    # Written in the order of rising fitness, and from last to first among equals, the right one is written last.
    order = np.lexsort((-np.arange(len(offspring_fitness)), offspring_fitness))
    heir = np.full(len(fitness), -1)
    heir[parents[order]] = order
    slots = np.flatnonzero(heir >= 0)
    slots = slots[offspring_fitness[heir[slots]] > fitness[slots]]
    return slots, heir[slots]
