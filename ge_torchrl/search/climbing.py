"""Climbing where steps are dear: a tree gives its place to a neighbour that won a race against it, again and again.

A climber starts at the best of many trees drawn at random. Some never leave where they begin, and the best climb ends
somewhere. So one that nothing beats any more waits while a challenger starts; when that is stuck too, the
better of both waits for the next one. After some challengers that were no better who waited goes on.
What refinement and evolution put into the archive takes part where the two are judged.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import LimitReachedError
from ge_torchrl.refiners.folding import half_of
from ge_torchrl.search.archive import RACE, Archive, Contender, confirmed, offer
from ge_torchrl.search.fitness import fitness_of, measure
from ge_torchrl.search.neighbours import folds, near, random_trees
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.racing import RACES, race
from ge_torchrl.search.refinement import snapped
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree, FloatArray

# So many races in a row that nobody wins, and a climber is stuck.
_STUCK: Final = 40
# After so many challengers in a row that were no better, who waited goes on for twice as many races.
_CHALLENGERS: Final = 3
# Climbers are judged on so many new common episodes.
_JUDGED_ON: Final = 30
# A start is the best of so many trees on few episodes, and of the best of them on more.
_DRAWN, _FIRST_EPISODES = 500, 4
# Where a run takes fewer steps than so many for each, fewer are drawn.
_STEPS_FOR_EACH, _FEWEST_DRAWN = 20_000, 25
_GO_ON, _MORE_EPISODES = 20, 20
# Before them a part as many are drawn, of which some are observed for some steps.
_FIRST_PART, _OBSERVED_TREES, _OBSERVED_STEPS = 5, 10, 200
# States of a climber, from which thresholds of its neighbours are drawn.
_OBSERVED: Final = 400


@dataclass(frozen=True, eq=False)
class Climber:
    """A tree that neighbours are raced against.

    Attributes:
        tree: The tree.
        observed: [T, D] float32, observations that it acted on.
        unbeaten: Races in a row that nobody won against it.
    """

    tree: DecisionTree
    observed: FloatArray
    unbeaten: int = 0


@dataclass(frozen=True, eq=False)
class Climbers:
    """The climber of a search, and the one that waits for it.

    Attributes:
        climber: Who is raced against; None before the first start.
        waiting: The best one before it, which it challenges; None where there is no challenge.
        patience: Races that nobody wins until who is no challenger is stuck.
        lost: Challengers in a row that were no better.
    """

    climber: Climber | None = None
    waiting: Climber | None = None
    patience: int = _STUCK
    lost: int = 0


def climb(
    problem: Problem, archive: Archive, climbers: Climbers, generation: int
) -> tuple[Archive, Climbers]:
    """Run a generation's races; return the archive, to which winners were offered, and the climbers after them.

    Args:
        problem: What is searched.
        archive: The kept trees.
        climbers: Of the generation before.
        generation: Number of the generation.

    Returns:
        Both as they are after the last race that the backend's limit left room for.
    """
    for number in range(problem.config.archive.races):
        rng = stream(problem.config.seed, f"climbing, generation {generation}, race {number}")
        try:
            climbers = _after_a_challenge(problem, archive, climbers, rng)
            if climbers.climber is None:
                archive, climbers = _started(problem, archive, climbers, rng)
            if (climber := climbers.climber) is None:
                break
            archive, climber = _raced(problem, archive, climber, rng)
        except LimitReachedError:
            break
        climbers = replace(climbers, climber=climber)
    return archive, climbers


def _after_a_challenge(
    problem: Problem, archive: Archive, climbers: Climbers, rng: np.random.Generator
) -> Climbers:
    """Return the climbers; where the climber is stuck it waits, or it, who waits and the best kept tree are judged."""
    climber, waiting = climbers.climber, climbers.waiting
    if climber is None or climber.unbeaten < (climbers.patience if waiting is None else _STUCK):
        return climbers
    if waiting is None:
        return replace(climbers, climber=None, waiting=climber)
    kept = max(archive.members, key=lambda member: member.archive_fitness, default=None)
    trees = [waiting.tree, climber.tree] + ([] if kept is None else [kept.tree])
    seeds = episode_seeds("training", _JUDGED_ON, rng)
    best = int(np.argmax(_fitness(problem, Forest.stack(trees), seeds)))
    if best > 0 and trees[best] != waiting.tree:
        return Climbers(waiting=climber if best == 1 else _at(problem, trees[best], rng))
    if climbers.lost + 1 < _CHALLENGERS:
        return replace(climbers, climber=None, lost=climbers.lost + 1)
    return Climbers(replace(waiting, unbeaten=0), patience=2 * climbers.patience)


def _started(
    problem: Problem, archive: Archive, climbers: Climbers, rng: np.random.Generator
) -> tuple[Archive, Climbers]:
    """Let a climber start at the best of many random trees, where the grammar has any that test something.

    What the best of the first trees see is what thresholds of the others are taken from. The first climber may start
    from a kept tree too; where trees are folded only from one that is its own image, as what evolution found seldom is.
    """
    n = _affordable(problem)
    first = random_trees(problem, n // _FIRST_PART, rng)
    if len(first) == 0:
        return archive, climbers
    first = _best(problem, first, _OBSERVED_TREES, _FIRST_EPISODES, rng)
    trees = first.trees()
    seen = problem.backend.observe(trees, _OBSERVED_STEPS, rng.spawn(len(trees)), RACES)
    others = random_trees(problem, n, rng, seen.reshape(-1, seen.shape[-1]))
    some = _best(problem, Forest.concatenate([first, others]), _GO_ON, _FIRST_EPISODES, rng)
    if climbers.waiting is None:
        kept = [member.tree for member in archive.members if _can_climb(problem, member.tree)]
        some = Forest.concatenate([some, Forest.stack(kept)]) if kept else some
    seeds = episode_seeds("training", _MORE_EPISODES, rng)
    fitness = _fitness(problem, some, seeds)
    tree, best = snapped(problem, some.tree(int(np.argmax(fitness)))), float(fitness.max())
    archive = offer(problem, archive, [Contender(tree, best, RACE)])
    return archive, replace(climbers, climber=_at(problem, tree, rng))


def _can_climb(problem: Problem, tree: DecisionTree) -> bool:
    if tree.num_decision_nodes == 0:
        return False
    return problem.mirror is None or not folds(problem) or half_of(tree, problem.mirror) is not None


def _affordable(problem: Problem) -> int:
    """Return how many random trees a start draws: fewer where a run may take few steps."""
    ge, speed = problem.config.ge, problem.config.evaluation.steps_per_second or math.inf
    steps = min(ge.max_env_steps or math.inf, (ge.max_seconds or math.inf) * speed)
    return int(max(_FEWEST_DRAWN, min(_DRAWN, steps / _STEPS_FOR_EACH)))


def _best(problem: Problem, forest: Forest, n: int, n_episodes: int, rng: np.random.Generator) -> Forest:
    """Return the best trees of a forest on new common episodes, the best first."""
    fitness = _fitness(problem, forest, episode_seeds("training", n_episodes, rng))
    return forest.take(np.argsort(-fitness, kind="stable")[:n])


def _at(problem: Problem, tree: DecisionTree, rng: np.random.Generator) -> Climber:
    (observed,) = problem.backend.observe([tree], _OBSERVED, [rng], RACES)
    return Climber(tree, observed)


def _raced(
    problem: Problem, archive: Archive, climber: Climber, rng: np.random.Generator
) -> tuple[Archive, Climber]:
    """Race a climber's neighbours against it; a winner is offered to the archive and takes its place."""
    trees = near(problem, climber.tree, climber.observed, problem.config.archive.raced, rng)
    raced = race(problem, climber.tree, trees, rng)
    if raced.winner is None:
        archive = confirmed(problem, archive, climber.tree, raced.parent_returns)
        return archive, replace(climber, unbeaten=climber.unbeaten + 1)
    penalty = problem.config.evaluation.std_penalty
    fitness = float(fitness_of(raced.winner_returns[np.newaxis], penalty)[0])
    after = offer(problem, archive, [Contender(raced.winner, fitness, RACE)])
    before = set(map(id, archive.members))
    new = [member.tree for member in after.members if id(member) not in before]
    # As it was pruned, where the archive keeps it.
    return after, _at(problem, (new or [raced.winner])[0], rng)


def _fitness(problem: Problem, forest: Forest, seeds: NDArray[np.int64]) -> NDArray[np.float64]:
    return measure(problem.backend, forest, seeds, RACES, problem.config.evaluation.std_penalty)
