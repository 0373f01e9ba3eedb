"""The choice of the tree that PPO refines (thesis, sections 3.3, 4.2.3 and 4.3.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.search.fitness import Fitness


@dataclass(frozen=True)
class Candidate:
    """A tree to refine.

    Attributes:
        individual: Its index in the population; None where no candidate was found.
        chosen: What the first draw was: "best" or "random".
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
    """

    solved_at: float | None
    lowest_fitness: float | None

    def admits(self, n_nodes: int, fitness: float) -> bool:
        """Tell whether a tree may be refined.

        Rejected are trees that (a) solve the task already, (b) are one leaf, (c) have one condition and two leaves,
        (d) have the lowest possible fitness; and individuals without a tree.

        Args:
            n_nodes: Nodes of the whole tree, 0 where there is none.
            fitness: Its fitness on the training episodes.
        """
        solves = self.solved_at is not None and fitness >= self.solved_at
        hopeless = self.lowest_fitness is not None and fitness <= self.lowest_fitness
        return n_nodes > 3 and not solves and not hopeless


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
