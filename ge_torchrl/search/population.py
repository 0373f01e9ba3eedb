"""Grammatical evolution as pure functions: a population in, the next population out.

A generation is five verbs: select, vary, map, measure, replace. All randomness is by name and generation, so that the
next population is a function of this one, the configuration and the generation's number.
"""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import LimitReachedError
from ge_torchrl.errors import UnencodableTreeError
from ge_torchrl.ge.codons import Codons
from ge_torchrl.ge.encoding import encode
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.ge.operators import crossover_one_point, mutate_uniform, random_population
from ge_torchrl.ge.selection import replace_parents, tournament
from ge_torchrl.search.fitness import WORST_FITNESS, Fitness, measure, training_seeds
from ge_torchrl.search.problem import Problem
from ge_torchrl.seeding import stream
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.simplify import simplify
from ge_torchrl.trees.tree import DecisionTree

TRAINING = "training"
"""The purpose that steps of measuring populations are counted under."""


@dataclass(frozen=True, eq=False)
class Population:
    """Genotypes, their trees and their fitness.

    Attributes:
        codons: [P, K] int32.
        forest: The P trees, without what no observation can reach; an invalid genotype has none.
        fitness: [P] float64, as each individual was last measured; WORST_FITNESS without a tree.
    """

    codons: Codons
    forest: Forest
    fitness: Fitness

    @property
    def best(self) -> int:
        """Index of the fittest individual; the first of equally fit ones."""
        return int(np.argmax(self.fitness))

    @property
    def sizes(self) -> NDArray[np.int64]:
        """[P] decision nodes of each tree, 0 where there is none."""
        return self.forest.num_decision_nodes

    def with_places_taken(self, slots: NDArray[np.int64], by: Population) -> Population:
        """Return the population with other individuals in some places.

        Args:
            slots: [R] int64, different places.
            by: The R individuals that take them.
        """
        if len(slots) == 0:
            return self
        codons, fitness = self.codons.copy(), self.fitness.copy()
        codons[slots], fitness[slots] = by.codons, by.fitness
        rows = np.arange(len(self.fitness))
        rows[slots] = len(rows) + np.arange(len(slots))
        return Population(codons, Forest.concatenate([self.forest, by.forest]).take(rows), fitness)

    def take(self, index: NDArray[np.int64]) -> Population:
        """Return some of the individuals."""
        return Population(self.codons[index], self.forest.take(index), self.fitness[index])


@dataclass(frozen=True, eq=False)
class Evolved:
    """A new population, and what making it took.

    Attributes:
        population: After replacement.
        born: Individuals made.
        invalid: Those of them without a tree.
        evaluation_seconds: Clock time of rollouts.
        variation_seconds: Clock time of selection, variation and mapping.
    """

    population: Population
    born: int
    invalid: int
    evaluation_seconds: float
    variation_seconds: float


def map_simplified(problem: Problem, codons: Codons) -> Forest:
    """Map genotypes [P, K] to their trees, without what no observation can reach."""
    return simplify(map_population(codons, problem.tables, problem.config.ge.wraps), *problem.backend.bounds)


def first_population(problem: Problem, generation: int = 0) -> Evolved:
    """Return a random population, in which one may rest; one beyond generation 0 begins the search anew."""
    ge, started = problem.config.ge, time.perf_counter()
    name = "first population" + (f", generation {generation}" if generation else "")
    rng = stream(problem.config.seed, name)
    codons = random_population(ge.population_size, ge.genotype_length, rng)
    _let_one_rest(problem, codons)
    forest = map_simplified(problem, codons)
    mapped = time.perf_counter()
    fitness = _measure(problem, forest, generation)
    return Evolved(
        population=Population(codons, forest, fitness),
        born=len(codons),
        invalid=int(np.count_nonzero(~forest.valid)),
        evaluation_seconds=time.perf_counter() - mapped,
        variation_seconds=mapped - started,
    )


def _let_one_rest(problem: Problem, codons: Codons) -> None:
    """Make the first genotype that of the leaf that does nothing, where actions are numbers and the grammar has it.

    Ant earns a thousand by standing still, which no random tree comes near.
    """
    spec = problem.backend.spec
    if spec.is_continuous:
        nothing = np.clip(0, spec.action_low, spec.action_high).tolist()
        with suppress(UnencodableTreeError):
            codons[0] = encode(
                DecisionTree.value_leaf(nothing), codons[0], problem.tables, problem.config.ge.wraps
            )


def next_population(problem: Problem, population: Population, generation: int) -> Evolved:
    """Return the population of a generation, made from that of the one before.

    Args:
        problem: What is searched.
        population: The population before.
        generation: Number of the generation to be made, at least 1.
    """
    config, started = problem.config, time.perf_counter()
    sizes = population.sizes if config.ge.parsimony == "lexicographic" else np.zeros_like(population.sizes)
    parents = tournament(
        population.fitness,
        sizes,
        len(population.fitness),
        config.ge.tournament_size,
        stream(config.seed, f"selection, generation {generation}"),
    )
    codons = _vary(problem, population.codons, parents, generation)
    forest = map_simplified(problem, codons)
    mapped = time.perf_counter()
    offspring = Population(codons, forest, _measure(problem, forest, generation))
    if config.evaluation.episode_seeds == "common":
        population = Population(
            population.codons, population.forest, _measure(problem, population.forest, generation)
        )
    measured = time.perf_counter()
    new_sizes = offspring.sizes if config.ge.parsimony == "lexicographic" else np.zeros_like(offspring.sizes)
    slots, winners = replace_parents((population.fitness, sizes), (offspring.fitness, new_sizes), parents)
    return Evolved(
        population=population.with_places_taken(slots, offspring.take(winners)),
        born=len(codons),
        invalid=int(np.count_nonzero(~forest.valid)),
        evaluation_seconds=measured - mapped,
        variation_seconds=mapped - started + time.perf_counter() - measured,
    )


def newcomers(problem: Problem, codons: Codons, generation: int) -> Population:
    """Return new individuals, measured on the training episodes of a generation.

    Args:
        problem: What is searched.
        codons: [R, K] int32.
        generation: Number of the generation.
    """
    forest = map_simplified(problem, codons)
    return Population(codons, forest, _measure(problem, forest, generation))


def _vary(problem: Problem, codons: Codons, parents: NDArray[np.int64], generation: int) -> Codons:
    ge = problem.config.ge
    rng = stream(problem.config.seed, f"variation, generation {generation}")
    if ge.crossover_probability > 0:
        codons = crossover_one_point(codons[parents], ge.crossover_probability, rng)
        parents = np.arange(len(codons))
    return mutate_uniform(codons, parents, ge.gene_probability, ge.mutation_probability, rng)


def _measure(problem: Problem, forest: Forest, generation: int) -> Fitness:
    seeds = training_seeds(problem.config, generation)
    penalty = problem.config.evaluation.std_penalty
    if problem.backend.limit is None or generation > 0:
        return measure(problem.backend, forest, seeds, TRAINING, penalty)
    return _measure_what_fits(problem, forest, seeds, penalty)


def _measure_what_fits(
    problem: Problem, forest: Forest, seeds: NDArray[np.int64], std_penalty: float
) -> Fitness:
    """Measure a first population in growing parts: where a limit ends it, what was measured is there."""
    fitness, done = np.full(len(forest), WORST_FITNESS), 0
    while done < len(forest):
        rows = np.arange(done, min(2 * done + 1, len(forest)))
        try:
            fitness[rows] = measure(problem.backend, forest.take(rows), seeds, TRAINING, std_penalty)
        except LimitReachedError:
            if not np.isfinite(fitness).any():
                raise
            break
        done += len(rows)
    return fitness
