"""The state of a search: everything that the next generation depends on, and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ge_torchrl.search.archive import Archive, Contender
from ge_torchrl.search.climbing import Climbers
from ge_torchrl.search.population import Population
from ge_torchrl.search.refinement import Refinement


@dataclass(frozen=True)
class Counts:
    """What a search counted, from its first generation on.

    Attributes:
        born: Individuals made.
        invalid: Those of them without a tree.
        refinements: Individuals refined by the refiner.
        improved: Those of them that became better.
        refined: All trees refined by the refiner.
        polished: Trees polished.
    """

    born: int = 0
    invalid: int = 0
    refinements: int = 0
    improved: int = 0
    refined: int = 0
    polished: int = 0


@dataclass(frozen=True, eq=False)
class SearchState:
    """A search after some generation.

    Attributes:
        generation: 0 for the random first population.
        population: The population.
        archive: The kept trees.
        set_aside: Archives of former starts, until all go on together.
        times_refined: How often trees of each structure were refined since the last start.
        best_refined: The fittest tree that refinement bettered; None before there is one.
        climbers: The trees that neighbours are raced against.
        counts: What was counted so far.
    """

    generation: int
    population: Population
    archive: Archive
    set_aside: tuple[Archive, ...] = ()
    times_refined: Mapping[bytes, int] = field(default_factory=dict)
    best_refined: Contender | None = None
    climbers: Climbers = field(default_factory=Climbers)
    counts: Counts = Counts()

    @property
    def best_fitness(self) -> float:
        """The fitness of the fittest individual or refined tree."""
        refined = self.best_refined.fitness if self.best_refined else float("-inf")
        return max(float(self.population.fitness.max()), refined)


@dataclass(frozen=True, eq=False)
class RefinementEvent:
    """One tree that the refiner refined, and what became of it in the population.

    Attributes:
        refinement: The refinement.
        written_back: Whether the snapped tree took its source's place.
        new_best: Whether it is fitter than all before it.
    """

    refinement: Refinement
    written_back: bool
    new_best: bool


@dataclass(frozen=True, eq=False)
class Events:
    """What happened in a generation, for those who watch; nothing that a search depends on.

    Attributes:
        refinements: Trees that the refiner refined.
        redraws: Rejected candidates where refinement was due and none was found; None where that did not happen.
        begins_anew: Whether the generation began the search anew.
        born: Individuals made in this generation.
        invalid: Those of them without a tree.
        evaluation_seconds: Clock time of the population's rollouts.
        variation_seconds: Clock time of selection, variation and mapping.
        refine_seconds: Clock time of the refiner.
        polish_seconds: Clock time of the polish.
    """

    refinements: tuple[RefinementEvent, ...] = ()
    redraws: int | None = None
    begins_anew: bool = False
    born: int = 0
    invalid: int = 0
    evaluation_seconds: float = 0.0
    variation_seconds: float = 0.0
    refine_seconds: float = 0.0
    polish_seconds: float = 0.0
