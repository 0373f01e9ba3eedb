"""The end of a search: kept trees are refined once more, validation chooses the champion and the best of each size.

The maximum over a population of a mean over few episodes overstates itself; a second measurement, on many episodes that
nothing was selected on, does not. The test that follows chooses nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import LimitReachedError, Outcomes
from ge_torchrl.ge.encoding import constants_near
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.refiners.protocol import Effort
from ge_torchrl.refiners.settling import settle
from ge_torchrl.search.archive import (
    POLISH,
    POPULATION,
    REFINEMENT,
    Contender,
    Member,
    offer,
    prune_all,
)
from ge_torchrl.search.fitness import fitness_of, measure, training_seeds, validation_seeds
from ge_torchrl.search.fitting_limits import evaluate_what_fits
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.refinement import refine_with_effort, snaps
from ge_torchrl.search.state import SearchState
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

FINAL, VALIDATION, TEST = "final refinement", "validation", "test"
"""The purposes that steps of the conclusion are counted under."""

# Constants so far away, in both directions, that a settling number may move to at once.
_STRIDES = (-4, -2, -1, 1, 2, 4)
# Kept trees that are refined at a time, where a limit may end it.
_TREES_AT_ONCE = 4


@dataclass(frozen=True, eq=False)
class Finalist:
    """A tree that validation has measured.

    Attributes:
        full: The tree as its genotype maps to it, or as it was kept.
        pruned: What the validation episodes need of it (thesis, section 2.4).
        origin: As of a contender.
        train_fitness: Its fitness on training episodes.
        archive_fitness: Its fitness on the archive's episodes; None where it is not kept.
        validation_returns: [E] float64, its returns on the validation episodes.
    """

    full: DecisionTree
    pruned: DecisionTree
    origin: str
    train_fitness: float
    archive_fitness: float | None
    validation_returns: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Verdict:
    """What a search ends with.

    Attributes:
        champion: The best tree.
        test_returns: [E] float64, of the pruned champion on unseen episodes.
        test_returns_full: [E] float64, of the champion as it was before pruning.
        by_size: The best tree of each size by validation, from small to large; none without an archive.
        test_returns_by_size: [S, E] float64, theirs; NaN where a limit left no room for a tree.
        test_visits: For each tree that was tested [L] int64, how often its leaves decided in these episodes.
    """

    champion: Finalist
    test_returns: NDArray[np.float64]
    test_returns_full: NDArray[np.float64]
    by_size: tuple[Finalist, ...]
    test_returns_by_size: NDArray[np.float64]
    test_visits: Mapping[DecisionTree, NDArray[np.int64]] = field(default_factory=dict)


def refine_once_more(problem: Problem, state: SearchState) -> SearchState:
    """Refine the best kept trees of each size with the effort of the end, and offer what comes out.

    Where a limit breaks it off, what was refined before is offered.

    Args:
        problem: What is searched.
        state: The state after the last generation.
    """
    settings, refiner = problem.config.archive, problem.polisher or problem.refiner
    if settings.final_keep == 0 or refiner is None:
        return state
    sizes = sorted({member.tree.num_decision_nodes for member in state.archive.members} - {0})
    trees = [member.tree for size in sizes for member in state.archive.of_size(size)[: settings.final_keep]]
    effort = Effort(settings.final_factor, settings.final_patience, settings.final_step)
    origin = REFINEMENT if problem.polisher is None else POLISH
    limited = problem.backend.limit is not None
    for first in range(0, len(trees), _TREES_AT_ONCE if limited else max(len(trees), 1)):
        some = trees[first : first + _TREES_AT_ONCE] if limited else trees
        try:
            refined = refine_with_effort(problem, refiner, some, effort, f"final refinement from {first} on")
            refined = _settled(problem, refined)
            seeds = training_seeds(problem.config, state.generation)
            fitness = measure(
                problem.backend, Forest.stack(refined), seeds, FINAL, problem.config.evaluation.std_penalty
            )
            contenders = [
                Contender(tree, float(value), origin) for tree, value in zip(refined, fitness, strict=True)
            ]
            state = replace(state, archive=offer(problem, state.archive, contenders))
        except LimitReachedError:
            break
    return state


def _settled(problem: Problem, trees: list[DecisionTree]) -> list[DecisionTree]:
    """Return snapped trees on the best constants near by: snapping rounds each number by itself, but they depend."""
    episodes = problem.config.polish.settling_episodes
    if episodes == 0 or not snaps(problem):
        return trees
    seeds = episode_seeds("training", episodes, stream(problem.config.seed, "settling"))
    grammar, penalty = problem.tables.grammar, problem.config.evaluation.std_penalty
    return [
        settle(
            tree,
            lambda some: constants_near(some, grammar, _STRIDES),
            lambda forest: measure(problem.backend, forest, seeds, FINAL, penalty),
        )
        for tree in trees
    ]


def contenders_of(problem: Problem, state: SearchState) -> list[Contender | Member]:
    """Return who competes for the champion: all kept trees, the fittest individual and the best refined tree.

    Without an archive it is the fitter of the last two alone, as in the thesis. Kept trees go first, since of equals
    the first is taken and they know where they come from.
    """
    population = state.population
    best = population.best
    fittest: list[Contender] = []
    if np.isfinite(population.fitness[best]):
        codons = population.codons[[best]]
        full = map_population(codons, problem.tables, problem.config.ge.wraps).tree(0)
        fittest.append(Contender(full, float(population.fitness[best]), POPULATION))
    if state.best_refined is not None:
        fittest.append(state.best_refined)
    if problem.config.archive.keep == 0:
        return [max(fittest, key=lambda contender: contender.fitness)] if fittest else []
    return [*state.archive.members, *fittest]


def train_fitness_of(contender: Contender | Member) -> float:
    """Return a tree's fitness on training episodes."""
    return contender.train_fitness if isinstance(contender, Member) else contender.fitness


def choose(
    problem: Problem, contenders: Sequence[Contender | Member]
) -> tuple[Finalist, tuple[Finalist, ...]]:
    """Choose the champion and the best tree of each size by validation, pruned on the same episodes.

    Of equally good trees the one with fewer decision nodes is taken, then the one that stands first.

    Args:
        problem: What is searched.
        contenders: At least one.

    Returns:
        The champion, and the best of each size from small to large.
    """
    # Where not all can be measured, the most promising are.
    ranked = sorted(range(len(contenders)), key=lambda i: -_promise_of(contenders[i]))
    trees = [contenders[i].tree for i in ranked]
    outcomes = evaluate_what_fits(problem, trees, validation_seeds(problem.config), VALIDATION, visits=True)
    measured = ranked[: len(outcomes.returns)]
    pruned = prune_all(trees[: len(measured)], outcomes.leaf_visits)
    fitness = fitness_of(outcomes.returns, problem.config.evaluation.std_penalty)
    order = sorted(
        range(len(measured)), key=lambda row: (-fitness[row], pruned[row].num_decision_nodes, measured[row])
    )
    best: dict[int, Finalist] = {}
    for row in order:
        finalist = _finalist(contenders[measured[row]], pruned[row], outcomes.returns[row])
        best.setdefault(finalist.pruned.num_decision_nodes, finalist)
    champion = best[pruned[order[0]].num_decision_nodes]
    return champion, tuple(best[size] for size in sorted(best))


def _promise_of(contender: Contender | Member) -> float:
    return contender.archive_fitness if isinstance(contender, Member) else contender.fitness


def _finalist(
    contender: Contender | Member, pruned: DecisionTree, validation_returns: NDArray[np.float64]
) -> Finalist:
    return Finalist(
        full=contender.tree,
        pruned=pruned,
        origin=contender.origin,
        train_fitness=train_fitness_of(contender),
        archive_fitness=contender.archive_fitness if isinstance(contender, Member) else None,
        validation_returns=validation_returns,
    )


def examine(problem: Problem, champion: Finalist, by_size: Sequence[Finalist]) -> Verdict:
    """Test the champion, pruned and as it was, and the best tree of each size on unseen episodes.

    Args:
        problem: What is searched; it says which episodes judge.
        champion: The champion.
        by_size: The best tree of each size; they are left out without an archive.
    """
    kept = tuple(by_size) if problem.config.archive.keep > 0 else ()
    # A champion stands among the best of each size too, and is often pruned already: each tree is tested once.
    both = dict.fromkeys((champion.pruned, champion.full))
    trees = list(both | dict.fromkeys(finalist.pruned for finalist in kept))
    outcomes = evaluate_what_fits(
        problem, trees, problem.judging_seeds(problem.config), TEST, visits=True, at_least=len(both)
    )
    untested = np.full(outcomes.returns.shape[1], np.nan)
    returns = dict(zip(trees, outcomes.returns, strict=False))
    by_size_returns = [returns.get(finalist.pruned, untested) for finalist in kept]
    return Verdict(
        champion=champion,
        test_returns=returns[champion.pruned],
        test_returns_full=returns[champion.full],
        by_size=kept,
        test_returns_by_size=np.array(by_size_returns).reshape(len(kept), len(untested)),
        test_visits=_visits_of(trees[: len(outcomes.returns)], outcomes),
    )


def _visits_of(trees: Sequence[DecisionTree], outcomes: Outcomes) -> dict[DecisionTree, NDArray[np.int64]]:
    if outcomes.leaf_visits is None:
        return {}
    ends = np.cumsum([tree.num_leaves for tree in trees])
    return dict(zip(trees, np.split(outcomes.leaf_visits, ends[:-1]), strict=True))
