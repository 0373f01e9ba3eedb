"""Grammatical evolution: a generation as five verbs — select, vary, map, measure, replace."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.route import Route
from ge_torchrl.ge.codons import Codons
from ge_torchrl.ge.mapping import Mapping, map_population
from ge_torchrl.ge.operators import crossover_one_point, mutate_uniform, random_population
from ge_torchrl.ge.parsimony import elite_lean, replace_parents_lean, tournament_lean
from ge_torchrl.ge.rule_tables import RuleTables
from ge_torchrl.ge.selection import elite, replace_parents, tournament
from ge_torchrl.search.fitness import Fitness, Measurement, TrainingEpisodes, measure
from ge_torchrl.sections import GEConfig
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.simplify import simplify_forest


@dataclass(frozen=True, eq=False)
class Generation:
    """The state of a run after one generation.

    Attributes:
        index: 0 for the random first population.
        codons: [P, K] int32, the population after replacement.
        fitness: [P] float64, as each individual was last measured.
        decision_nodes: [P] int64, of each individual's tree without what no state can reach; 0 where there is none.
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
    decision_nodes: NDArray[np.int64]
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
        std_penalty: As `measure` takes it.
    """

    settings: GEConfig
    tables: RuleTables
    route: Route
    episodes: TrainingEpisodes
    rng: np.random.Generator
    std_penalty: float = 0.0

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
        leaf = Forest.stack([DecisionTree.leaf(0)])
        self.decision_nodes(leaf)
        self.route.evaluate(leaf, np.zeros(1, np.int64))

    def map(self, codons: Codons) -> Mapping:
        """Map genotypes [P, K] to their trees."""
        return map_population(codons, self.tables, self.settings.wraps)

    def decision_nodes(self, forest: Forest) -> NDArray[np.int64]:
        """Return [P], the decision nodes of each tree without what no state can reach."""
        # A tree has one leaf more than decision nodes.
        return simplify_forest(forest, self.route.spec.low, self.route.spec.high).sizes // 2

    def measure(self, forest: Forest, seeds: NDArray[np.int64]) -> Measurement:
        """Measure the fitness of every tree on these episodes."""
        return measure(self.route, forest, seeds, self.std_penalty)

    def with_places_taken(
        self, generation: Generation, slots: NDArray[np.int64], codons: Codons
    ) -> tuple[Generation, int]:
        """Let new genotypes take the places of less fit individuals.

        Args:
            generation: The generation, whose training episodes measure them.
            slots: [R] int64, different places.
            codons: [R, K] int32, for each place the genotype that takes it if it is fitter.

        Returns:
            The generation, the very same one where nobody gave way, and environment steps.
        """
        forest = self.map(codons).forest
        measured = self.measure(forest, generation.seeds)
        fitter = measured.fitness > generation.fitness[slots]
        if not fitter.any():
            return generation, measured.env_steps
        newcomers = _Individuals(codons, measured.fitness, self.decision_nodes(forest))
        # Other records may hold the arrays of this generation: they are copied, not written to.
        old = _Individuals(generation.codons, generation.fitness, generation.decision_nodes)
        now = old.with_places_taken(slots[fitter], newcomers.take(np.flatnonzero(fitter)))
        generation = replace(
            generation, codons=now.codons, fitness=now.fitness, decision_nodes=now.decision_nodes
        )
        return generation, measured.env_steps

    def first(self) -> Generation:
        """Return the random first generation."""
        clock = _Clock()
        codons = random_population(self.settings.population_size, self.settings.genotype_length, self.rng)
        mapping = self.map(codons)
        sizes = self.decision_nodes(mapping.forest)
        clock.variation_ends()
        seeds = self.episodes.next_generation()
        measured = self.measure(mapping.forest, seeds)
        clock.evaluation_ends()
        invalid = _n_invalid(mapping)
        return Generation(
            index=0,
            codons=codons,
            fitness=measured.fitness,
            decision_nodes=sizes,
            seeds=seeds,
            n_born=len(codons),
            n_invalid=invalid,
            env_steps=measured.env_steps,
            evaluation_seconds=clock.evaluation,
            variation_seconds=clock.variation,
        )

    def after(self, current: Generation) -> Generation:
        """Return the generation that follows; `current` may be one that the caller has edited."""
        clock = _Clock()
        old = _Individuals(current.codons, current.fitness, current.decision_nodes)
        parents = self._select(old)
        offspring = self._vary(current.codons, parents)
        mapping = self.map(offspring)
        sizes = self.decision_nodes(mapping.forest)
        old_forest = self.map(current.codons).forest if self.episodes.remeasures_parents else None
        clock.variation_ends()
        seeds = self.episodes.next_generation()
        measured = self.measure(mapping.forest, seeds)
        env_steps = measured.env_steps
        if old_forest is not None:
            remeasured = self.measure(old_forest, seeds)
            env_steps += remeasured.env_steps
            old = replace(old, fitness=remeasured.fitness)
        clock.evaluation_ends()
        now = self._replace(old, _Individuals(offspring, measured.fitness, sizes), parents)
        clock.variation_ends()
        return Generation(
            index=current.index + 1,
            codons=now.codons,
            fitness=now.fitness,
            decision_nodes=now.decision_nodes,
            seeds=seeds,
            n_born=len(offspring),
            n_invalid=_n_invalid(mapping),
            env_steps=env_steps,
            evaluation_seconds=clock.evaluation,
            variation_seconds=clock.variation,
        )

    def _select(self, old: _Individuals) -> NDArray[np.int64]:
        settings = self.settings
        size = settings.tournament_size
        if settings.parsimony == "none":
            return tournament(old.fitness, settings.population_size, size, self.rng)
        tolerance = settings.parsimony_tolerance
        return tournament_lean(
            old.fitness, old.decision_nodes, tolerance, settings.population_size, size, self.rng
        )

    def _vary(self, codons: Codons, parents: NDArray[np.int64]) -> Codons:
        settings = self.settings
        if settings.crossover_probability > 0:
            codons = crossover_one_point(codons[parents], settings.crossover_probability, self.rng)
            parents = np.arange(len(codons))
        return mutate_uniform(
            codons, parents, settings.gene_probability, settings.mutation_probability, self.rng
        )

    def _replace(self, old: _Individuals, new: _Individuals, parents: NDArray[np.int64]) -> _Individuals:
        kept = self._elite(old, self.settings.elites)
        if self.settings.replacement == "generational":
            return old.take(kept).followed_by(new.take(self._elite(new, len(old.codons) - len(kept))))
        if self.settings.parsimony == "none":
            slots, winners = replace_parents(old.fitness, new.fitness, parents)
        else:
            slots, winners = replace_parents_lean(
                (old.fitness, old.decision_nodes),
                (new.fitness, new.decision_nodes),
                self.settings.parsimony_tolerance,
                parents,
            )
        free = ~np.isin(slots, kept)
        return old.with_places_taken(slots[free], new.take(winners[free]))

    def _elite(self, individuals: _Individuals, n: int) -> NDArray[np.int64]:
        if self.settings.parsimony == "none":
            return elite(individuals.fitness, n)
        return elite_lean(individuals.fitness, individuals.decision_nodes, n)


@dataclass(frozen=True, eq=False)
class _Individuals:
    """What selection and replacement move about; attributes as in `Generation`."""

    codons: Codons
    fitness: Fitness
    decision_nodes: NDArray[np.int64]

    def take(self, index: NDArray[np.int64]) -> _Individuals:
        return _Individuals(self.codons[index], self.fitness[index], self.decision_nodes[index])

    def followed_by(self, other: _Individuals) -> _Individuals:
        return _Individuals(
            np.concatenate([self.codons, other.codons]),
            np.concatenate([self.fitness, other.fitness]),
            np.concatenate([self.decision_nodes, other.decision_nodes]),
        )

    def with_places_taken(self, slots: NDArray[np.int64], by: _Individuals) -> _Individuals:
        if len(slots) == 0:
            return self
        codons, fitness, sizes = self.codons.copy(), self.fitness.copy(), self.decision_nodes.copy()
        codons[slots], fitness[slots], sizes[slots] = by.codons, by.fitness, by.decision_nodes
        return _Individuals(codons, fitness, sizes)


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
