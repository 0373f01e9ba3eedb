"""The choice of trees to refine: the best or random ones (thesis, sections 3.3, 4.2.3 and 4.3.3), or of each size.

Beyond the thesis: one niche a number of decision nodes, as in an archive of elites (Mouret and Clune, "Illuminating
search spaces by mapping elites", 2015), since the best trees of a population are mostly of one size, and a better
structure is of another.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.search.fitness import Fitness
from ge_torchrl.trees.forest import Forest


@dataclass(frozen=True)
class Candidate:
    """A tree to refine.

    Attributes:
        individual: Its index in the population; None where no candidate was found.
        chosen: What the first draw was: "best" or "random"; "fittest" where it is the fittest of its structure.
        redraws: How many trees were rejected.
    """

    individual: int | None
    chosen: str
    redraws: int


@dataclass(frozen=True)
class Eligibility:
    """What PPO cannot improve, or is not worth trying on.

    Attributes:
        solved_at: A tree of this fitness or more solves the task already; None where nothing counts as solved.
        lowest_fitness: A tree of this fitness never saw a reward, so that PPO has nothing to learn from; or None.
        min_nodes: Decision nodes of the smallest trees that are worth trying on; 2 in the thesis.
    """

    solved_at: float | None
    lowest_fitness: float | None
    min_nodes: int = 2

    def admits(self, n_nodes: int, fitness: float) -> bool:
        """Tell whether a tree may be refined.

        Rejected are trees that (a) solve the task already, (b) are one leaf, (c) have one condition and two leaves, or
        less than `min_nodes`, (d) have the lowest possible fitness; and individuals without a tree.

        Args:
            n_nodes: Nodes of the whole tree, 0 where there is none.
            fitness: Its fitness on the training episodes.
        """
        solves = self.solved_at is not None and fitness >= self.solved_at
        hopeless = self.lowest_fitness is not None and fitness <= self.lowest_fitness
        # A tree has one leaf more than decision nodes.
        return n_nodes > 2 * self.min_nodes and not solves and not hopeless


def choose_candidate(
    fitness: Fitness,
    n_nodes: NDArray[np.int64],
    eligibility: Eligibility,
    best_probability: float,
    rng: np.random.Generator,
) -> Candidate:
    """Choose the best tree or a random one; redraw at random while it is rejected, `P` times at the most.

    Args:
        fitness: [P] float64.
        n_nodes: [P] int64, nodes of each tree.
        eligibility: What is rejected.
        best_probability: Probability that the first draw is the best tree.
        rng: Source of randomness.
    """
    population_size = len(fitness)
    chosen = "best" if rng.random() < best_probability else "random"
    individual = int(np.argmax(fitness)) if chosen == "best" else int(rng.integers(population_size))
    redraws = 0
    while not eligibility.admits(int(n_nodes[individual]), float(fitness[individual])):
        if redraws == population_size:
            return Candidate(None, chosen, redraws)
        individual = int(rng.integers(population_size))
        redraws += 1
    return Candidate(individual, chosen, redraws)


def choose_candidates(
    fitness: Fitness,
    n_nodes: NDArray[np.int64],
    eligibility: Eligibility,
    best_probability: float,
    n_candidates: int,
    rng: np.random.Generator,
) -> list[Candidate]:
    """Choose the first candidate as `choose_candidate` does, the others at random among all that may be refined.

    Args:
        fitness: [P] float64.
        n_nodes: [P] int64, nodes of each tree.
        eligibility: What is rejected.
        best_probability: Probability that the first draw is the best tree.
        n_candidates: How many different individuals to choose; fewer are chosen where fewer may be refined.
        rng: Source of randomness.

    Returns:
        At least one; the first has no individual where none was found, and is then the only one.
    """
    first = choose_candidate(fitness, n_nodes, eligibility, best_probability, rng)
    if first.individual is None or n_candidates == 1:
        return [first]
    others = [
        individual
        for individual in range(len(fitness))
        if individual != first.individual
        and eligibility.admits(int(n_nodes[individual]), float(fitness[individual]))
    ]
    drawn = rng.choice(others, size=min(n_candidates - 1, len(others)), replace=False) if others else ()
    return [first, *(Candidate(int(individual), "random", 0) for individual in drawn)]


def choose_of_each_size(
    fitness: Fitness,
    forest: Forest,
    eligibility: Eligibility,
    n_candidates: int,
    times_refined: Mapping[bytes, int],
) -> list[Candidate]:
    """Choose the fittest tree of every size, then the next of every size; structures seldom refined go first.

    Of one structure only the fittest tree is chosen. Nothing here is drawn at random.

    Args:
        fitness: [P] float64.
        forest: The P trees.
        eligibility: What is rejected.
        n_candidates: How many trees to choose; fewer are chosen where there are fewer structures.
        times_refined: How often each structure was refined before; 0 for those that are not in it.

    Returns:
        At least one; a lone one without an individual where nothing may be refined.
    """
    sizes = forest.sizes
    admitted = [i for i in range(len(forest)) if eligibility.admits(int(sizes[i]), float(fitness[i]))]
    if not admitted:
        return [Candidate(None, "fittest", 0)]
    alike = fittest_of_each_structure(forest, fitness, admitted)
    individuals = np.array(list(alike.values()))
    times = np.array([times_refined.get(structure, 0) for structure in alike])
    order = in_turns(fitness[individuals], sizes[individuals])
    order = order[np.argsort(times[order], kind="stable")]
    return [Candidate(int(individual), "fittest", 0) for individual in individuals[order[:n_candidates]]]


def fittest_of_each_structure(
    forest: Forest, fitness: Fitness, individuals: Sequence[int]
) -> dict[bytes, int]:
    """Return the fittest individual of each structure, the first of equally fit ones.

    Args:
        forest: The P trees.
        fitness: [P] float64.
        individuals: Who is considered.
    """
    fittest: dict[bytes, int] = {}
    for individual in individuals:
        structure = forest.structure(individual)
        best = fittest.setdefault(structure, individual)
        if fitness[individual] > fitness[best]:
            fittest[structure] = individual
    return fittest


def in_turns(fitness: NDArray[np.float64], sizes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return an order that takes the fittest of every size first, then the second of every size, and so on.

    Args:
        fitness: [P] float64.
        sizes: [P] int64.

    Returns:
        [P] int64, indices.
    """
    by_fitness = np.argsort(-fitness, kind="stable")
    turn = np.empty(len(fitness), np.int64)
    for size in np.unique(sizes):
        of_size = by_fitness[sizes[by_fitness] == size]
        turn[of_size] = np.arange(len(of_size))
    return np.lexsort((-fitness, turn))
