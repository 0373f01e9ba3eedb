"""One generation as a function: `step(problem, state) -> state, events`. No files, no screen, no generator is carried.

A generation evolves, proposes, refines, writes back and offers. A step that a limit breaks off leaves the state before
it as it was; nothing of it has happened.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from ge_torchrl.environments.backend import LimitReachedError
from ge_torchrl.errors import UnencodableTreeError
from ge_torchrl.ge.codons import Codons
from ge_torchrl.ge.encoding import encode
from ge_torchrl.search.archive import POLISH, POPULATION, REFINEMENT, Archive, Contender, leaders, offer
from ge_torchrl.search.climbing import climb
from ge_torchrl.search.neighbours import propose_neighbours
from ge_torchrl.search.population import Evolved, Population, first_population, newcomers, next_population
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.proposals import (
    INDIVIDUAL,
    Proposal,
    propose_individuals,
    propose_kept,
)
from ge_torchrl.search.refinement import IMPROVED, Refinement, Refinements, refine_proposals
from ge_torchrl.search.restarts import begins_anew, goes_on_together, together
from ge_torchrl.search.starts import dense_starts
from ge_torchrl.search.state import Counts, Events, RefinementEvent, SearchState
from ge_torchrl.seeding import stream
from ge_torchrl.trees.tree import DecisionTree


def first_state(problem: Problem) -> tuple[SearchState, Events]:
    """Return the state of generation 0: a random population, and its leaders in the archive.

    Where a limit breaks it off, what was measured is there.

    Raises:
        LimitReachedError: The backend's limit was reached before any tree was measured.
    """
    evolved, archive = first_population(problem), Archive()
    with suppress(LimitReachedError):
        archive = offer(problem, archive, leaders(evolved.population, problem.config.archive.max_nodes))
    state = SearchState(0, evolved.population, archive, counts=Counts(evolved.born, evolved.invalid))
    return state, _events(evolved, Refinements())


def step(problem: Problem, state: SearchState) -> tuple[SearchState, Events]:
    """Return the state after one more generation, and what happened in it.

    Args:
        problem: What is searched.
        state: The state; it stays as it is.

    Raises:
        LimitReachedError: The backend's limit was reached; the state is still the last one.
    """
    generation = state.generation + 1
    if begins_anew(problem.config.ge, generation):
        return _anew(problem, state, generation)
    if goes_on_together(problem.config.ge, generation):
        state = together(problem, state)
    evolved = next_population(problem, state.population, generation)
    population = evolved.population
    proposals, redraws = _proposals(problem, state, population, generation)
    refinements = refine_proposals(problem, proposals, generation)
    written = _write_back(problem, population, refinements.refinements, generation)
    archive = offer(
        problem,
        state.archive,
        # What is written back leads too, but is not evolution's: who is offered first gives a tree its origin.
        [
            *_contenders(refinements),
            *dense_starts(problem, population, generation),
            *leaders(written.population, problem.config.archive.max_nodes),
        ],
    )
    climbers = state.climbers
    if not problem.races_in(generation):
        archive, climbers = climb(problem, archive, climbers, generation)
    population = written.population
    if proposals or problem.config.archive.races > 0:
        population = _migrate(problem, population, archive, generation)
    refined = [one for one in refinements.refinements if one.training is not None]
    after = SearchState(
        generation=generation,
        population=population,
        archive=archive,
        set_aside=state.set_aside,
        times_refined=_counted(state, proposals),
        best_refined=_best_refined(state.best_refined, refined),
        climbers=climbers,
        counts=_counts(state.counts, evolved, refined, refinements.polished),
    )
    events = _refinement_events(state, evolved.population, refined, written.slots)
    return after, replace(_events(evolved, refinements), refinements=events, redraws=redraws)


def _anew(problem: Problem, state: SearchState, generation: int) -> tuple[SearchState, Events]:
    """Begin anew with another random population; the archive so far is set aside."""
    evolved = first_population(problem, generation)
    archive = offer(problem, Archive(), leaders(evolved.population, problem.config.archive.max_nodes))
    after = replace(
        state,
        generation=generation,
        population=evolved.population,
        archive=archive,
        set_aside=(*state.set_aside, state.archive),
        times_refined={},
        counts=_counts(state.counts, evolved, [], 0),
    )
    return after, replace(_events(evolved, Refinements()), begins_anew=True)


def _proposals(
    problem: Problem, state: SearchState, population: Population, generation: int
) -> tuple[list[Proposal], int | None]:
    """Return the proposals of a generation, and how many candidates were rejected where none was found."""
    due = problem.refines_in(generation)
    if not due and not problem.polishes_in(generation):
        return [], None
    drawn = propose_individuals(problem, population, state.times_refined, generation)
    others = [
        *propose_neighbours(problem, state.archive, state.times_refined, generation),
        *propose_kept(problem, state.archive, generation),
    ]
    return [*drawn.proposals, *others], drawn.redraws if due and not drawn.proposals else None


@dataclass(frozen=True, eq=False)
class _WrittenBack:
    population: Population
    slots: frozenset[int]


def _write_back(
    problem: Problem, population: Population, refinements: Sequence[Refinement], generation: int
) -> _WrittenBack:
    """Let refined individuals take their own places, in their own codons, where the snapped tree is the fitter one.

    The codons are the source's, edited where the tree differs (law 2), so whatever else a genotype carries is
    inherited on.
    """
    if not problem.config.refiner.write_back:
        return _WrittenBack(population, frozenset())
    slots, codons = [], []
    for one in refinements:
        slot = one.proposal.individual
        if slot is not None and one.is_changed and one.fitness > population.fitness[slot]:
            encoded = _encoded(problem, one.tree, population.codons[slot])
            if encoded is not None:
                slots.append(slot)
                codons.append(encoded)
    return _with_fitter(problem, population, slots, codons, generation)


def _migrate(problem: Problem, population: Population, archive: Archive, generation: int) -> Population:
    """Let kept trees take the places of less fit individuals, written into the codons that are there."""
    n = problem.config.archive.migrants
    if n == 0 or not archive.members:
        return population
    slots, codons = [], []
    drawn = stream(problem.config.seed, f"migrants, generation {generation}").integers(
        len(archive.members), size=n
    )
    for slot, member in zip(np.argsort(population.fitness, kind="stable")[:n], drawn, strict=False):
        encoded = _encoded(problem, archive.members[member].tree, population.codons[slot])
        if encoded is not None:
            slots.append(int(slot))
            codons.append(encoded)
    return _with_fitter(problem, population, slots, codons, generation).population


def _encoded(problem: Problem, tree: DecisionTree, codons: Codons) -> Codons | None:
    try:
        return encode(tree, codons, problem.tables, problem.config.ge.wraps)
    except UnencodableTreeError:
        return None


def _with_fitter(
    problem: Problem, population: Population, slots: list[int], codons: list[Codons], generation: int
) -> _WrittenBack:
    """Let new genotypes take places of less fit individuals, measured on the generation's training episodes."""
    if not slots:
        return _WrittenBack(population, frozenset())
    new = newcomers(problem, np.stack(codons), generation)
    places = np.array(slots)
    fitter = np.flatnonzero(new.fitness > population.fitness[places])
    taken = population.with_places_taken(places[fitter], new.take(fitter))
    return _WrittenBack(taken, frozenset(map(int, places[fitter])))


def _contenders(refinements: Refinements) -> list[Contender]:
    return [
        Contender(one.tree, one.fitness, _origin(one, polished=refinements.polished > 0))
        for one in refinements.refinements
    ]


def _origin(refinement: Refinement, *, polished: bool) -> str:
    if refinement.outcome == IMPROVED:
        return REFINEMENT
    if refinement.proposal.origin == INDIVIDUAL and not refinement.is_changed:
        return POPULATION
    return POLISH if polished else REFINEMENT


def _counted(state: SearchState, proposals: Sequence[Proposal]) -> dict[bytes, int]:
    return dict(Counter(state.times_refined) + Counter(one.tree.structure for one in proposals))


def _best_refined(best: Contender | None, refined: Sequence[Refinement]) -> Contender | None:
    """Return the fittest tree that the refiner bettered, snapped where that is so too, else as it was hardened."""
    for one in refined:
        if one.outcome != IMPROVED:
            continue
        tree, fitness = one.refined, one.fitness_after
        # What the grammar can say is what a person reads with ease.
        if (
            one.snapped is not None
            and one.fitness_snapped is not None
            and one.fitness_snapped > one.fitness_before
        ):
            tree, fitness = one.snapped, one.fitness_snapped
        if best is None or fitness > best.fitness:
            best = Contender(tree, fitness, REFINEMENT)
    return best


def _counts(counts: Counts, evolved: Evolved, refined: Sequence[Refinement], polished: int) -> Counts:
    individuals = [one for one in refined if one.proposal.origin == INDIVIDUAL]
    return Counts(
        born=counts.born + evolved.born,
        invalid=counts.invalid + evolved.invalid,
        refinements=counts.refinements + len(individuals),
        improved=counts.improved + sum(one.outcome == IMPROVED for one in individuals),
        refined=counts.refined + len(refined),
        polished=counts.polished + polished,
    )


def _refinement_events(
    state: SearchState, population: Population, refined: Sequence[Refinement], written: frozenset[int]
) -> tuple[RefinementEvent, ...]:
    before = max(state.best_fitness, float(population.fitness.max()))
    events = []
    for one in refined:
        new_best = one.outcome == IMPROVED and one.fitness_after > before
        before = max(before, one.fitness_after) if new_best else before
        slot = one.proposal.individual
        events.append(RefinementEvent(one, slot is not None and slot in written, new_best))
    return tuple(events)


def _events(evolved: Evolved, refinements: Refinements) -> Events:
    return Events(
        born=evolved.born,
        invalid=evolved.invalid,
        evaluation_seconds=evolved.evaluation_seconds,
        variation_seconds=evolved.variation_seconds,
        refine_seconds=sum(one.seconds for one in refinements.refinements),
        polish_seconds=refinements.polish_seconds,
    )
