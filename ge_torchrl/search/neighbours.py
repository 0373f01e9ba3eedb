"""Neighbours of kept trees as proposals: drawn by edits and crossings, judged as they are or after a short polish."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.ge.encoding import can_derive
from ge_torchrl.search.archive import Archive
from ge_torchrl.search.fitness import measure, training_seeds
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.proposals import NEIGHBOUR, Proposal, fittest_of_each_structure, in_turns
from ge_torchrl.search.shortlist import best_after_a_short_polish
from ge_torchrl.seeding import stream
from ge_torchrl.trees.edits import Neighbourhood, forest_of
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.simplify import simplify

NEIGHBOURS: Final = "neighbours"
"""The purpose that steps of measuring neighbours are counted under."""
# How often a tree for the short list is a crossing of two kept trees, not a neighbour of one; tried on Acrobot.
_CROSSED_PROBABILITY: Final = 0.3


def propose_neighbours(
    problem: Problem, archive: Archive, times_refined: Mapping[bytes, int], generation: int
) -> list[Proposal]:
    """Draw neighbours of kept trees and choose the fittest of each size, each of a structure not refined yet.

    With a short list these are polished for a short while, and the best of them are chosen.

    Args:
        problem: What is searched.
        archive: The kept trees.
        times_refined: How often each structure was refined before.
        generation: Number of the generation, whose training episodes judge neighbours.
    """
    settings, config = problem.config.archive, problem.config
    offers = problem.tables.grammar.split_offers
    features = np.array(sorted({feature for offer in offers for feature in offer.linear.weights}), np.int64)
    # A grammar of leaves alone tests no feature, so its trees have no neighbours.
    if settings.neighbours == 0 or not archive.members or len(features) == 0:
        return []
    rng = stream(config.seed, f"neighbours, generation {generation}")
    short_list = settings.short_list if problem.polishes_in(generation) else 0
    drawn = _draw(problem, archive, features, rng, crossed=_CROSSED_PROBABILITY if short_list > 0 else 0.0)
    sizes = drawn.num_decision_nodes
    untried = np.array(
        [
            i
            for i in np.flatnonzero((sizes > 0) & (sizes <= settings.max_nodes))
            if drawn.structure(int(i)) not in times_refined
        ],
        np.int64,
    )
    if len(untried) == 0:
        return []
    drawn = drawn.take(untried)
    seeds = training_seeds(config, generation)
    fitness = measure(problem.backend, drawn, seeds, NEIGHBOURS, config.evaluation.std_penalty)
    best = np.array(list(fittest_of_each_structure(drawn, fitness, np.arange(len(drawn))).values()))
    # A grammar can say more than which features there are.
    derivable = (
        (tree, float(fitness[i]))
        for i in map(int, best[in_turns(fitness[best], drawn.num_decision_nodes[best])])
        if can_derive(tree := drawn.tree(i), problem.tables)
    )
    if short_list == 0:
        chosen = list(islice(derivable, settings.neighbours))
    else:
        trees = [tree for tree, _ in islice(derivable, short_list)]
        chosen = best_after_a_short_polish(problem, archive, trees, settings.neighbours, generation)
    return [Proposal(tree, NEIGHBOUR, value) for tree, value in chosen]


def _draw(
    problem: Problem,
    archive: Archive,
    features: NDArray[np.int64],
    rng: np.random.Generator,
    *,
    crossed: float,
) -> Forest:
    """Draw neighbours of kept trees that small tournaments, every second one of one, choose; or crossings of two."""
    members, spec = archive.members, problem.backend.spec
    fitness = np.array([member.archive_fitness for member in members])
    hoods: dict[int, Neighbourhood] = {}

    def parent() -> Neighbourhood:
        entrants = rng.integers(len(members), size=int(rng.integers(1, 3)))
        chosen = int(entrants[np.argmax(fitness[entrants])])
        if chosen not in hoods:
            hoods[chosen] = Neighbourhood(
                members[chosen].tree,
                members[chosen].observed,
                oblique=problem.is_oblique,
                linear=problem.has_linear_leaves,
                action_bounds=spec.names.action_bounds,
            )
        return hoods[chosen]

    drawn = []
    for _ in range(problem.config.archive.neighbours_drawn):
        first = parent()
        if crossed > 0 and rng.random() < crossed:
            drawn.append(first.crossed_with(parent(), rng))
        else:
            drawn.append(first.draw(features, spec.n_actions, rng))
    return simplify(forest_of(drawn), *problem.backend.bounds)
