"""Selection with a pressure on size: of individuals that are about equally fit the smaller one is better.

Two individuals are about equally fit if their fitness differs by no more than a tolerance. Source: S. Luke and
L. Panait, "Lexicographic parsimony pressure", GECCO 2002, which is the case of tolerance 0. With another tolerance
"about equally fit" is not transitive, so several individuals are always held against the fittest of them.
"""

import numpy as np
from numpy.typing import NDArray

Fitness = NDArray[np.float64]
Sizes = NDArray[np.int64]


def tournament_lean(
    fitness: Fitness,
    sizes: Sizes,
    tolerance: float,
    n_offspring: int,
    tournament_size: int,
    rng: np.random.Generator,
) -> NDArray[np.int64]:
    """Select parents by tournaments: of the entrants about as fit as the fittest the smallest wins.

    Of equally small ones the fitter wins, then the one drawn first. The draws are those of `selection.tournament`.

    Args:
        fitness: [P] float64.
        sizes: [P] int64.
        tolerance: Largest difference of about equal fitness, at least 0.
        n_offspring: Number of parents to select, O.
        tournament_size: Number of individuals in a tournament, at least 1.
        rng: Source of randomness.

    Returns:
        [O] int64, indices of the parents.
    """
    entrants = rng.integers(len(fitness), size=(n_offspring, tournament_size))
    fit, size = fitness[entrants], sizes[entrants]
    about_best = fit >= fit.max(axis=1, keepdims=True) - tolerance
    smallest = np.where(about_best, size, np.iinfo(np.int64).max).min(axis=1, keepdims=True)
    winners = np.argmax(np.where(about_best & (size == smallest), fit, -np.inf), axis=1)
    parents: NDArray[np.int64] = entrants[np.arange(n_offspring), winners]
    return parents


def elite_lean(fitness: Fitness, sizes: Sizes, n_elite: int) -> NDArray[np.int64]:
    """Return the fittest individuals, best first; of equally fit ones the smaller, then the lower index comes first.

    There is no tolerance here: the elite is what must not be lost, and the fittest is.

    Args:
        fitness: [P] float64.
        sizes: [P] int64.
        n_elite: Number of individuals, at most P.

    Returns:
        [n_elite] int64, their indices.
    """
    return np.lexsort((sizes, -fitness))[:n_elite]


def is_better(
    fitness: Fitness, sizes: Sizes, than: tuple[Fitness, Sizes], tolerance: float
) -> NDArray[np.bool_]:
    """Tell where an individual is better than its counterpart: clearly fitter, or about as fit and smaller.

    Of about equally fit individuals of one size the fitter is better.

    Args:
        fitness: [O] float64.
        sizes: [O] int64.
        than: [O] each, fitness and sizes of the counterparts.
        tolerance: Largest difference of about equal fitness, at least 0.
    """
    other, other_sizes = than
    smaller = (sizes < other_sizes) | ((sizes == other_sizes) & (fitness > other))
    better: NDArray[np.bool_] = (fitness > other + tolerance) | ((fitness >= other - tolerance) & smaller)
    return better


def replace_parents_lean(
    population: tuple[Fitness, Sizes],
    offspring: tuple[Fitness, Sizes],
    tolerance: float,
    parents: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Decide which offspring take their parents' places: one takes its parent's if `is_better` says so.

    Of several such offspring of one parent the one takes its place that would win their tournament. A place can thus
    lose fitness, by at most the tolerance for each decision node that its individual loses.

    Args:
        population: [P] each, fitness and sizes.
        offspring: [O] each, fitness and sizes.
        tolerance: Largest difference of about equal fitness, at least 0.
        parents: [O] int64, the index in the population of each offspring's parent.

    Returns:
        The indices [R] of the replaced and of the offspring that take their places, in the order of the replaced.
    """
    fitness, sizes = offspring
    of_parents = (population[0][parents], population[1][parents])
    better = is_better(fitness, sizes, of_parents, tolerance)
    best = np.full(len(population[0]), -np.inf)
    np.maximum.at(best, parents[better], fitness[better])
    heirs = better & (fitness >= best[parents] - tolerance)
    # From large to small, then in the order of rising fitness, then from last to first: the right one is written last.
    order = np.lexsort((-np.arange(len(fitness)), fitness, -sizes))
    order = order[heirs[order]]
    heir = np.full(len(population[0]), -1)
    heir[parents[order]] = order
    slots = np.flatnonzero(heir >= 0)
    return slots, heir[slots]
