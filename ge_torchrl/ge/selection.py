"""Selection: who has offspring, and who makes room for it.

An individual is better than another if it is fitter, or as fit and smaller (S. Luke and L. Panait, "Lexicographic
parsimony pressure", GECCO 2002). Where all sizes are equal that is selection by fitness alone. A higher fitness is
better; none may be NaN.
"""

import numpy as np
from numpy.typing import NDArray

Fitness = NDArray[np.float64]
Sizes = NDArray[np.int64]


def tournament(
    fitness: Fitness, sizes: Sizes, n_offspring: int, tournament_size: int, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Select parents by tournaments: the best of `tournament_size` individuals drawn with replacement.

    Of equally good ones the one drawn first wins, so that equally good means equal chances.

    Args:
        fitness: [P] float64.
        sizes: [P] int64.
        n_offspring: Number of parents to select, O.
        tournament_size: Number of individuals in a tournament, at least 1.
        rng: Source of randomness.

    Returns:
        [O] int64, indices of the parents.

    Source:
        D. E. Goldberg and K. Deb, "A comparative analysis of selection schemes used in genetic algorithms",
        Foundations of Genetic Algorithms 1, 1991.
    """
    entrants = rng.integers(len(fitness), size=(n_offspring, tournament_size))
    fit = fitness[entrants]
    is_fittest = fit == fit.max(axis=1, keepdims=True)
    winners = np.argmin(np.where(is_fittest, sizes[entrants], np.iinfo(np.int64).max), axis=1)
    parents: NDArray[np.int64] = entrants[np.arange(n_offspring), winners]
    return parents


def replace_parents(
    population: tuple[Fitness, Sizes], offspring: tuple[Fitness, Sizes], parents: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Decide which offspring take their parents' places: one takes its parent's if it is better.

    Individuals that were no parents stay. Of several better offspring of one parent the best takes its place, of
    equally good ones the first: what one gets by going through the offspring in order, as section 1.3 of the thesis
    tells it.

    Args:
        population: [P] each, fitness and sizes.
        offspring: [O] each, fitness and sizes.
        parents: [O] int64, the index in the population of each offspring's parent.

    Returns:
        The indices [R] of the replaced and of the offspring that take their places, in the order of the replaced.
    """
    fitness, sizes = offspring
    # Written from worst to best, and from last to first among equals, the right one is written last.
    order = np.lexsort((-np.arange(len(fitness)), -sizes, fitness))
    heir = np.full(len(population[0]), -1)
    heir[parents[order]] = order
    slots = np.flatnonzero(heir >= 0)
    heirs = heir[slots]
    than, than_sizes = population[0][slots], population[1][slots]
    is_better = (fitness[heirs] > than) | ((fitness[heirs] == than) & (sizes[heirs] < than_sizes))
    return slots[is_better], heirs[is_better]
