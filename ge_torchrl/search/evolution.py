"""Grammatical evolution: a generation as five verbs — select, vary, map, measure, replace."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.route import Route
from ge_torchrl.ge.codons import Codons
from ge_torchrl.ge.mapping import Mapping, map_population
from ge_torchrl.ge.operators import crossover_one_point, mutate_uniform, random_population
from ge_torchrl.ge.rule_tables import RuleTables
from ge_torchrl.ge.selection import elite, replace_parents, tournament
from ge_torchrl.search.fitness import Fitness, TrainingEpisodes, measure
from ge_torchrl.sections import GEConfig
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest


@dataclass(frozen=True, eq=False)
class Generation:
    """The state of a run after one generation.

    Attributes:
        index: 0 for the random first population.
        codons: [P, K] int32, the population after replacement.
        fitness: [P] float64, as each individual was last measured.
        seeds: [E] int64, the training episodes of this generation.
        n_born: Individuals made in this generation.
        n_invalid: Those of them without a tree.
        env_steps: Environment steps of this generation.
        evaluation_seconds: Clock time spent in rollouts.
        variation_seconds: Clock time spent in selection, variation and mapping.
    """

    index: int
    codons: Codons
    fitness: Fitness
    seeds: NDArray[np.int64]
    n_born: int
    n_invalid: int
    env_steps: int
    evaluation_seconds: float
    variation_seconds: float

    @property
    def best(self) -> int:
        """Index of the fittest individual; the first of equally fit ones."""
        return int(np.argmax(self.fitness))


@dataclass(frozen=True, eq=False)
class Evolution:
    """Evolves a population of genotypes in one environment.

    Attributes:
        settings: Sizes, probabilities and the replacement.
        tables: The compiled grammar.
        route: Runs trees.
        episodes: The training episodes of each generation.
        rng: Stream of the first population, selection and variation.
    """

    settings: GEConfig
    tables: RuleTables
    route: Route
    episodes: TrainingEpisodes
    rng: np.random.Generator

    def generations(self) -> Iterator[Generation]:
        """Yield generation after generation, without end; the caller decides when to stop."""
        current = self.first()
        while True:
            yield current
            current = self.after(current)

    def warm_up(self) -> None:
        """Load or compile every kernel, so that a clock started afterwards measures evolution."""
        codons = np.zeros((1, self.settings.genotype_length), np.int32)
        self.map(mutate_uniform(codons, np.zeros(1, np.int64), 0.5, 1.0, np.random.default_rng(0)))
        self.route.evaluate(Forest.stack([DecisionTree.leaf(0)]), np.zeros(1, np.int64))

    def map(self, codons: Codons) -> Mapping:
        """Map genotypes [P, K] to their trees."""
        return map_population(codons, self.tables, self.settings.wraps)

    def first(self) -> Generation:
        """Return the random first generation."""
        clock = _Clock()
        codons = random_population(self.settings.population_size, self.settings.genotype_length, self.rng)
        mapping = self.map(codons)
        clock.variation_ends()
        seeds = self.episodes.next_generation()
        measured = measure(self.route, mapping.forest, seeds)
        clock.evaluation_ends()
        return Generation(
            index=0,
            codons=codons,
            fitness=measured.fitness,
            seeds=seeds,
            n_born=len(codons),
            n_invalid=_n_invalid(mapping),
            env_steps=measured.env_steps,
            evaluation_seconds=clock.evaluation,
            variation_seconds=clock.variation,
        )

    def after(self, current: Generation) -> Generation:
        """Return the generation that follows; `current` may be one that the caller has edited."""
        clock = _Clock()
        parents = tournament(
            current.fitness, self.settings.population_size, self.settings.tournament_size, self.rng
        )
        offspring = self._vary(current.codons, parents)
        mapping = self.map(offspring)
        old_forest = self.map(current.codons).forest if self.episodes.remeasures_parents else None
        clock.variation_ends()
        seeds = self.episodes.next_generation()
        measured = measure(self.route, mapping.forest, seeds)
        env_steps, fitness = measured.env_steps, current.fitness
        if old_forest is not None:
            remeasured = measure(self.route, old_forest, seeds)
            env_steps, fitness = env_steps + remeasured.env_steps, remeasured.fitness
        clock.evaluation_ends()
        codons, fitness = self._replace(current.codons, fitness, offspring, measured.fitness, parents)
        clock.variation_ends()
        return Generation(
            index=current.index + 1,
            codons=codons,
            fitness=fitness,
            seeds=seeds,
            n_born=len(offspring),
            n_invalid=_n_invalid(mapping),
            env_steps=env_steps,
            evaluation_seconds=clock.evaluation,
            variation_seconds=clock.variation,
        )

    def _vary(self, codons: Codons, parents: NDArray[np.int64]) -> Codons:
        settings = self.settings
        if settings.crossover_probability > 0:
            codons = crossover_one_point(codons[parents], settings.crossover_probability, self.rng)
            parents = np.arange(len(codons))
        return mutate_uniform(
            codons, parents, settings.gene_probability, settings.mutation_probability, self.rng
        )

    def _replace(
        self,
        codons: Codons,
        fitness: Fitness,
        offspring: Codons,
        offspring_fitness: Fitness,
        parents: NDArray[np.int64],
    ) -> tuple[Codons, Fitness]:
        kept = elite(fitness, self.settings.elites)
        if self.settings.replacement == "generational":
            survivors = elite(offspring_fitness, len(codons) - len(kept))
            return (
                np.concatenate([codons[kept], offspring[survivors]]),
                np.concatenate([fitness[kept], offspring_fitness[survivors]]),
            )
        slots, winners = replace_parents(fitness, offspring_fitness, parents)
        free = ~np.isin(slots, kept)
        slots, winners = slots[free], winners[free]
        if len(slots) == 0:
            return codons, fitness
        new_codons, new_fitness = codons.copy(), fitness.copy()
        new_codons[slots] = offspring[winners]
        new_fitness[slots] = offspring_fitness[winners]
        return new_codons, new_fitness


def _n_invalid(mapping: Mapping) -> int:
    return int(np.count_nonzero(~mapping.valid))


class _Clock:
    """Splits a generation's time between evaluation and all the rest."""

    def __init__(self) -> None:
        self._last = time.perf_counter()
        self.evaluation = self.variation = 0.0

    def _lap(self) -> float:
        now = time.perf_counter()
        elapsed, self._last = now - self._last, now
        return elapsed

    def evaluation_ends(self) -> None:
        self.evaluation += self._lap()

    def variation_ends(self) -> None:
        self.variation += self._lap()
