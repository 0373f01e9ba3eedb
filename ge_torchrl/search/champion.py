"""The champion: the one tree that a run answers with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.route import Route
from ge_torchrl.ge.mapping import Mapping
from ge_torchrl.search.fitness import Fitness, measure
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.simplify import prune, simplify_exact

POPULATION, REFINEMENT, NEIGHBOUR = "population", "refinement", "neighbour"


@dataclass(frozen=True, eq=False)
class Contender:
    """A tree that might be the champion.

    Attributes:
        tree: The tree.
        fitness: Its fitness on the training episodes, or for a refined tree on its measuring episodes.
        origin: POPULATION, REFINEMENT for a refined individual, or NEIGHBOUR for a tree refined in exploring.
    """

    tree: DecisionTree
    fitness: float
    origin: str


@dataclass(frozen=True, eq=False)
class Champion:
    """The best tree of a run.

    Attributes:
        full: The tree as its genotype maps to it, or as it was hardened.
        pruned: What the validation episodes need of it (thesis, section 2.4).
        train_fitness: The fitness that made it a contender.
        validation_mean: Its mean return on the validation episodes.
        origin: As of a contender.
        env_steps: Environment steps that choosing and pruning took.
    """

    full: DecisionTree
    pruned: DecisionTree
    train_fitness: float
    validation_mean: float
    origin: str
    env_steps: int


def contenders_of(mapping: Mapping, fitness: Fitness) -> list[Contender]:
    """Return the individuals that have a tree, the fittest first."""
    return [
        Contender(mapping.forest.tree(individual), float(fitness[individual]), POPULATION)
        for individual in np.argsort(-fitness, kind="stable")
        if mapping.valid[individual]
    ]


def choose_champion(
    route: Route,
    contenders: Sequence[Contender],
    n_candidates: int,
    validation_seeds: NDArray[np.int64],
    hall_of_fame: Sequence[Contender] = (),
) -> Champion:
    """Choose among the fittest trees by testing them again, on many episodes that none was selected on.

    The maximum over a population of a mean over few episodes overstates itself; the leaders' second measurement does
    not. Of equally good trees the one with fewer decision nodes is taken, then the fitter.

    Args:
        route: Runs the trees.
        contenders: At least one; of equally fit ones the first leads.
        n_candidates: How many trees that act differently are tested again.
        validation_seeds: [E] episode seeds used for nothing else.
        hall_of_fame: Trees that are tested again whatever their fitness: they were measured well before.

    Returns:
        The champion, pruned on the same episodes.
    """
    leaders = _leaders(route, contenders, n_candidates)
    for contender in hall_of_fame:
        leaders.setdefault(contender.tree, contender)
    simple = list(leaders)
    validated = measure(route, Forest.stack(simple), validation_seeds)
    rank = min(range(len(simple)), key=lambda c: (-validated.fitness[c], simple[c].n_decision_nodes, c))
    chosen = leaders[simple[rank]]
    visits = route.count_visits(chosen.tree, validation_seeds)
    return Champion(
        full=chosen.tree,
        pruned=prune(chosen.tree, visits),
        train_fitness=chosen.fitness,
        validation_mean=float(validated.fitness[rank]),
        origin=chosen.origin,
        env_steps=validated.env_steps + int(visits[0]),
    )


def _leaders(
    route: Route, contenders: Sequence[Contender], n_candidates: int
) -> dict[DecisionTree, Contender]:
    """Return the fittest contenders by their simplified trees, each of these once, best first."""
    leaders: dict[DecisionTree, Contender] = {}
    for contender in sorted(contenders, key=lambda contender: -contender.fitness):
        if len(leaders) == n_candidates:
            break
        leaders.setdefault(simplify_exact(contender.tree, route.spec.low, route.spec.high), contender)
    return leaders
