"""Proposals: the trees that a generation refines.

Individuals of the population, as in the thesis (sections 3.3, 4.2.3 and 4.3.3) or the fittest of each size; neighbours
of kept trees, one or two edits away; and kept trees again. Evolution keeps what is fit as it is: a new structure is
mostly worse until its numbers fit it, and dies before that. So neighbours are refined first and judged then.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.ge.mapping import map_population
from ge_torchrl.refiners.protocol import FIRST, Effort
from ge_torchrl.search.archive import Archive
from ge_torchrl.search.fitness import Fitness
from ge_torchrl.search.population import Population
from ge_torchrl.search.problem import Problem
from ge_torchrl.seeding import stream
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

INDIVIDUAL, NEIGHBOUR, KEPT = "individual", "neighbour", "archive"
"""The origins of a proposal."""
# How often the thesis' draw takes the best tree (its section 3.3), not a random one.
_BEST_PROBABILITY = 0.5


@dataclass(frozen=True, eq=False)
class Proposal:
    """A tree to refine.

    Attributes:
        tree: The tree.
        origin: INDIVIDUAL, NEIGHBOUR or KEPT.
        fitness: Its fitness on the generation's training episodes; of a kept tree on the archive's.
        individual: Index in the population; None for what is no individual.
        effort: How much is spent on it.
        chosen: How it was chosen: "best" or "random" by the thesis' draw, "fittest" of its structure.
        redraws: Trees that were rejected before it.
    """

    tree: DecisionTree
    origin: str
    fitness: float
    individual: int | None = None
    effort: Effort = FIRST
    chosen: str = "fittest"
    redraws: int = 0


@dataclass(frozen=True)
class Eligibility:
    """What refinement cannot improve, or is not worth trying on.

    Attributes:
        solved_at: A tree of this fitness or more solves the task already; None where nothing counts as solved.
        lowest_return: A tree of this fitness never saw a reward, so that PPO has nothing to learn from; or None.
        min_nodes: Decision nodes of the smallest trees that are worth trying on; 2 in the thesis.
    """

    solved_at: float | None
    lowest_return: float | None
    min_nodes: int = 2

    def admits(self, num_decision_nodes: int, fitness: float) -> bool:
        """Tell whether a tree may be refined.

        Rejected are trees that (a) solve the task already, (b) are one leaf, (c) have one condition and two leaves, or
        less than `min_nodes`, (d) have the lowest possible fitness; and individuals without a tree.
        """
        solves = self.solved_at is not None and fitness >= self.solved_at
        hopeless = self.lowest_return is not None and fitness <= self.lowest_return
        has_tree = bool(np.isfinite(fitness))
        return has_tree and num_decision_nodes >= self.min_nodes and not solves and not hopeless


@dataclass(frozen=True, eq=False)
class Drawn:
    """The individuals that a generation proposes.

    Attributes:
        proposals: The proposals; none where no candidate was found.
        redraws: Trees that were rejected in the thesis' draw of the first one.
    """

    proposals: tuple[Proposal, ...]
    redraws: int


def propose_individuals(
    problem: Problem, population: Population, times_refined: Mapping[bytes, int], generation: int
) -> Drawn:
    """Choose individuals to refine.

    Args:
        problem: What is searched.
        population: The population.
        times_refined: How often each structure was refined before.
        generation: Number of the generation.
    """
    settings, config = problem.config.refiner, problem.config
    forest = population.forest
    if not settings.write_back:
        forest = map_population(population.codons, problem.tables, config.ge.wraps)
    eligibility = Eligibility(problem.backend.spec.solved_at, config.env.lowest_return, settings.min_nodes)
    admitted = np.array(
        [
            eligibility.admits(int(n), float(f))
            for n, f in zip(forest.num_decision_nodes, population.fitness, strict=True)
        ]
    )
    redraws, chosen = 0, "fittest"
    if settings.choice == "each_size":
        individuals = of_each_size(population.fitness, forest, admitted, times_refined)[: settings.candidates]
    else:
        rng = stream(config.seed, f"candidates, generation {generation}")
        individuals, chosen, redraws = best_or_random(population.fitness, admitted, settings.candidates, rng)
    return Drawn(
        tuple(
            Proposal(
                forest.tree(i),
                INDIVIDUAL,
                float(population.fitness[i]),
                i,
                chosen=chosen if place == 0 or chosen == "fittest" else "random",
                redraws=redraws if place == 0 else 0,
            )
            for place, i in enumerate(individuals)
        ),
        redraws,
    )


def best_or_random(
    fitness: Fitness,
    admitted: NDArray[np.bool_],
    n_candidates: int,
    rng: np.random.Generator,
) -> tuple[list[int], str, int]:
    """Choose the best tree or a random one, redrawn at random while it is rejected, `P` times at the most; then others.

    Args:
        fitness: [P] float64.
        admitted: [P] bool, who may be refined.
        n_candidates: How many different individuals to choose; the others at random among all that may be refined.
        rng: Source of randomness.

    Returns:
        The individuals, none where the draws found none; what the first draw was, "best" or "random"; and redraws.
    """
    chosen = "best" if rng.random() < _BEST_PROBABILITY else "random"
    individual = int(np.argmax(fitness)) if chosen == "best" else int(rng.integers(len(fitness)))
    redraws = 0
    while not admitted[individual]:
        if redraws == len(fitness):
            return [], chosen, redraws
        individual = int(rng.integers(len(fitness)))
        redraws += 1
    others = np.flatnonzero(admitted & (np.arange(len(fitness)) != individual))
    drawn = rng.choice(others, size=min(n_candidates - 1, len(others)), replace=False)
    return [individual, *map(int, drawn)], chosen, redraws


def of_each_size(
    fitness: Fitness, forest: Forest, admitted: NDArray[np.bool_], times_refined: Mapping[bytes, int]
) -> list[int]:
    """Return the fittest tree of every size, then the next of every size; structures seldom refined go first.

    Of one structure only the fittest tree is chosen. Nothing here is drawn at random.

    Args:
        fitness: [P] float64.
        forest: The P trees.
        admitted: [P] bool, who may be refined.
        times_refined: How often each structure was refined before; 0 for those that are not in it.
    """
    alike = fittest_of_each_structure(forest, fitness, np.flatnonzero(admitted))
    individuals = np.array(list(alike.values()), np.int64)
    times = np.array([times_refined.get(structure, 0) for structure in alike], np.int64)
    order = in_turns(fitness[individuals], forest.num_decision_nodes[individuals])
    order = order[np.argsort(times[order], kind="stable")]
    return [int(i) for i in individuals[order]]


def fittest_of_each_structure(
    forest: Forest, fitness: Fitness, individuals: NDArray[np.int64]
) -> dict[bytes, int]:
    """Return the fittest individual of each structure, the first of equally fit ones.

    Args:
        forest: The P trees.
        fitness: [P] float64.
        individuals: Who is considered.
    """
    fittest: dict[bytes, int] = {}
    for individual in map(int, individuals):
        best = fittest.setdefault(forest.structure(individual), individual)
        if fitness[individual] > fitness[best]:
            fittest[forest.structure(individual)] = individual
    return fittest


def in_turns(fitness: NDArray[np.float64], sizes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return an order [P] that takes the fittest of every size first, then the second of every size, and so on."""
    by_fitness = np.argsort(-fitness, kind="stable")
    turn = np.empty(len(fitness), np.int64)
    for size in np.unique(sizes):
        of_size = by_fitness[sizes[by_fitness] == size]
        turn[of_size] = np.arange(len(of_size))
    return np.lexsort((-fitness, turn))


def propose_kept(problem: Problem, archive: Archive, generation: int) -> list[Proposal]:
    """Choose a kept tree, at random, to refine again with more effort; none where that is not asked for."""
    settings = problem.config.archive
    if settings.revisit_factor == 0:
        return []
    rng = stream(problem.config.seed, f"revisits, generation {generation}")
    members = [member for member in archive.members if member.tree.num_decision_nodes > 0]
    effort = Effort(settings.revisit_factor)
    return [
        Proposal(members[i].tree, KEPT, members[i].archive_fitness, effort=effort, chosen="random")
        for i in map(int, rng.permutation(len(members))[:1])
    ]
