"""The champion: the one tree that a run answers with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.route import Route
from ge_torchrl.ge.mapping import Mapping
from ge_torchrl.search.fitness import Fitness, measure
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.simplify import prune, simplify_forest


@dataclass(frozen=True, eq=False)
class Champion:
    """The best tree of a run.

    Attributes:
        full: The tree as its genotype maps to it.
        pruned: What the validation episodes need of it (thesis, section 2.4).
        individual: Its index in the population.
        train_fitness: Its fitness on the training episodes.
        validation_mean: Its mean return on the validation episodes.
        env_steps: Environment steps that choosing and pruning took.
    """

    full: DecisionTree
    pruned: DecisionTree
    individual: int
    train_fitness: float
    validation_mean: float
    env_steps: int


def choose_champion(
    route: Route,
    mapping: Mapping,
    fitness: Fitness,
    n_candidates: int,
    validation_seeds: NDArray[np.int64],
) -> Champion:
    """Choose among the fittest trees by testing them again, on many episodes that none was selected on.

    The maximum over a population of a mean over few episodes overstates itself; the leaders' second measurement does
    not. Of equally good trees the one with fewer decision nodes is taken, then the fitter.

    Args:
        route: Runs the trees.
        mapping: The population's trees, at least one of them valid.
        fitness: [P] float64, on the training episodes.
        n_candidates: How many trees that act differently are tested again.
        validation_seeds: [E] episode seeds used for nothing else.

    Returns:
        The champion, pruned on the same episodes.
    """
    candidates, simple = _leaders(route, mapping, fitness, n_candidates)
    validated = measure(route, Forest.stack(simple), validation_seeds)
    rank = min(
        range(len(candidates)),
        key=lambda c: (-validated.fitness[c], simple[c].n_decision_nodes, c),
    )
    full = mapping.forest.tree(candidates[rank])
    visits = route.count_visits(full, validation_seeds)
    return Champion(
        full=full,
        pruned=prune(full, visits),
        individual=candidates[rank],
        train_fitness=float(fitness[candidates[rank]]),
        validation_mean=float(validated.fitness[rank]),
        env_steps=validated.env_steps + int(visits[0]),
    )


def _leaders(
    route: Route, mapping: Mapping, fitness: Fitness, n_candidates: int
) -> tuple[list[int], list[DecisionTree]]:
    """Return the fittest individuals, each simplified tree once, best first."""
    forest = simplify_forest(mapping.forest, route.spec.low, route.spec.high)
    leaders: dict[DecisionTree, int] = {}
    for individual in np.argsort(-fitness, kind="stable"):
        if len(leaders) == n_candidates:
            break
        if mapping.valid[individual]:
            leaders.setdefault(forest.tree(individual), int(individual))
    return list(leaders.values()), list(leaders)
