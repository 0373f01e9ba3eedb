"""Neighbours of kept trees as proposals: drawn by edits and crossings, judged as they are or after a short polish."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.ge.encoding import can_derive
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.ge.operators import random_population
from ge_torchrl.refiners.folding import fold_observations, half_of, whole_of
from ge_torchrl.refiners.local_search import as_floats, spread_of
from ge_torchrl.refiners.mirror import Mirror
from ge_torchrl.refiners.ties import ties_in
from ge_torchrl.search.archive import Archive
from ge_torchrl.search.fitness import measure, training_seeds
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.proposals import NEIGHBOUR, Proposal, fittest_of_each_structure, in_turns
from ge_torchrl.search.refinement import snapped
from ge_torchrl.search.shortlist import best_after_a_short_polish
from ge_torchrl.seeding import stream
from ge_torchrl.trees.arrays import FloatArray
from ge_torchrl.trees.edits import Neighbourhood, forest_of
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.nodes import Nodes, Split, nodes_of
from ge_torchrl.trees.simplify import simplify
from ge_torchrl.trees.tree import DecisionTree

NEIGHBOURS: Final = "neighbours"
"""The purpose that steps of measuring neighbours are counted under."""
# How often a tree for the short list is a crossing of two kept trees, not a neighbour of one; tried on Acrobot.
_CROSSED_PROBABILITY: Final = 0.3
# How often a neighbour for a race is moved in one of its numbers, not edited, by this part of its unit or more.
_MOVED_PROBABILITY: Final = 0.15
_SHORTEST_MOVE: Final = 0.02
# How often a test of half a tree is put at 0, where its feature changes sign.
_CENTRED_PROBABILITY: Final = 0.15
_HALF: Final = 0.5
# Random trees have so many splits before a mirror unfolds them; so many genotypes are drawn for each.
_FEWEST_SPLITS, _MOST_SPLITS, _TIMES_DRAWN = 2, 8, 10


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
    features = features_of(problem)
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


def near(
    problem: Problem, tree: DecisionTree, observed: FloatArray, n: int, rng: np.random.Generator
) -> list[DecisionTree]:
    """Draw neighbours of a tree to race against it: edits of its structure, and moves of one of its numbers.

    A tree that is its own image in a mirror has neighbours that are their own images.

    Args:
        problem: What is searched.
        tree: The tree.
        observed: [T, D] float32, observations that it acted on.
        n: How many are drawn; of these what the grammar cannot say, and what is no other tree, is left out.
        rng: Source of randomness.
    """
    mirror = problem.mirror
    half = None if mirror is None else half_of(tree, mirror)
    edited, seen = tree, observed
    if mirror is not None and half is not None:
        edited, seen = forest_of([half]).tree(0), fold_observations(half, observed, mirror)
    hood, features = _hood(problem, edited, seen), features_of(problem)
    drawn: list[Nodes] = []
    for _ in range(_TIMES_DRAWN * n):
        if len(drawn) == n:
            break
        nodes: Nodes | None
        if rng.random() < _MOVED_PROBABILITY:
            nodes = nodes_of(_moved(problem, edited, seen, rng))
        else:
            nodes = hood.draw(features, problem.backend.spec.n_actions, rng)
        if mirror is not None and half is not None:
            nodes = whole_of(_centred(nodes, mirror, rng), mirror)
        if nodes is not None:
            drawn.append(nodes)
    return _distinct(problem, simplify(forest_of(drawn), *problem.backend.bounds), tree)


def folds(problem: Problem) -> bool:
    """Tell whether trees of the grammar can be folded in a mirror: splits test one feature, leaves hold actions."""
    return problem.mirror is not None and not problem.is_oblique and not problem.backend.spec.is_continuous


def random_trees(
    problem: Problem, n: int, rng: np.random.Generator, observed: FloatArray | None = None
) -> Forest:
    """Return random trees of the grammar, `n` or fewer; with a mirror they are their own images.

    Args:
        problem: What is searched.
        n: How many are wanted.
        rng: Source of randomness.
        observed: [T, D] float32, what other trees saw: thresholds of axis-aligned splits are taken from it. None
            leaves them as the grammar drew them.
    """
    ge, mirror, largest = problem.config.ge, problem.mirror, problem.config.archive.max_nodes
    codons = random_population(_TIMES_DRAWN * n, ge.genotype_length, rng)
    forest = map_population(codons, problem.tables, ge.wraps)
    sizes = forest.num_decision_nodes
    some = np.flatnonzero(forest.valid & (sizes >= _FEWEST_SPLITS) & (sizes <= min(_MOST_SPLITS, largest)))
    # Small trees are drawn far more often: here each size comes in its turn.
    forest = forest.take(some[in_turns(np.zeros(len(some)), sizes[some])])
    if observed is not None and forest.is_axis_aligned:
        feature = forest.arrays.feature
        seen = observed[rng.integers(len(observed), size=len(feature)), feature]
        forest = Forest(forest.arrays._replace(threshold=seen))
    if mirror is not None and folds(problem):
        halves = (_centred(nodes_of(tree), mirror, rng) for tree in forest.trees())
        wholes = (whole_of(half, mirror) for half in halves)
        forest = forest_of(list(islice((whole for whole in wholes if whole is not None), n)))
    forest = simplify(forest, *problem.backend.bounds)
    sizes = forest.num_decision_nodes
    return forest.take(np.flatnonzero((sizes > 0) & (sizes <= largest))[:n])


def _centred(nodes: Nodes, mirror: Mirror, rng: np.random.Generator) -> Nodes:
    """Return half of a tree, sometimes with a test at 0 of a feature that changes its sign in the mirror."""
    places = [
        (place, node)
        for place, node in enumerate(nodes)
        if isinstance(node, Split) and mirror.sign[node.feature[0]] < 0
    ]
    if not places or rng.random() >= _CENTRED_PROBABILITY:
        return nodes
    place, node = places[int(rng.random() * len(places))]
    return [*nodes[:place], node._replace(threshold=0.0), *nodes[place + 1 :]]


def _moved(
    problem: Problem, tree: DecisionTree, observed: FloatArray, rng: np.random.Generator
) -> DecisionTree:
    """Return a tree with one of its numbers, and what is tied to it, moved by up to what its feature spreads."""
    ties = ties_in(tree, problem.mirror)
    if len(ties.leading) == 0:
        return tree
    units = tree.parameter_units(spread_of(observed), problem.backend.spec.names.action_spread)[ties.leading]
    numbers = tree.parameters.astype(np.float64)[ties.leading]
    one = int(rng.random() * len(numbers))
    sign = 1 if rng.random() < _HALF else -1
    numbers[one] += sign * _SHORTEST_MOVE ** rng.random() * units[one]
    return tree.with_parameters(as_floats(ties.parameters(numbers)))


def _distinct(problem: Problem, forest: Forest, other_than: DecisionTree) -> list[DecisionTree]:
    """Return the trees of a forest on the grammar's constants, each once, as far as they are small enough."""
    sizes, largest = forest.num_decision_nodes, problem.config.archive.max_nodes
    found: dict[DecisionTree, None] = {}
    for i in np.flatnonzero((sizes > 0) & (sizes <= largest)).tolist():
        if can_derive(tree := forest.tree(i), problem.tables):
            found.setdefault(snapped(problem, tree))
    found.pop(other_than, None)
    return list(found)


def features_of(problem: Problem) -> NDArray[np.int64]:
    """Return the features that the grammar tests."""
    offers = problem.tables.grammar.split_offers
    return np.array(sorted({feature for offer in offers for feature in offer.linear.weights}), np.int64)


def _hood(problem: Problem, tree: DecisionTree, observed: FloatArray) -> Neighbourhood:
    return Neighbourhood(
        tree,
        observed,
        oblique=problem.is_oblique,
        linear=problem.has_linear_leaves,
        action_bounds=problem.backend.spec.names.action_bounds,
    )


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
            hoods[chosen] = _hood(problem, members[chosen].tree, members[chosen].observed)
        return hoods[chosen]

    drawn = []
    for _ in range(problem.config.archive.neighbours_drawn):
        first = parent()
        if crossed > 0 and rng.random() < crossed:
            drawn.append(first.crossed_with(parent(), rng))
        else:
            drawn.append(first.draw(features, spec.n_actions, rng))
    return simplify(forest_of(drawn), *problem.backend.bounds)
