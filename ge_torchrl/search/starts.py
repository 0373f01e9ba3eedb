"""Dense starts: trees whose splits weigh all features, raced against each other from nothing.

Evolution builds sums term by term, and a sum is worth little before most of its terms are there. So where the grammar
has sums, a search also begins at the other end: with the few splits that a chain of all actions needs, over all
features, their numbers found by an evolution strategy that starts at zero: of every second start in units of how far
features spread, and of the others in the environment's own. They run in heats.

Where the grammar has no sums and steps are dear, the rule that comes of a race is imitated by trees of the grammar.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import Backend, within
from ge_torchrl.refiners.local_search import spread_of
from ge_torchrl.refiners.mirror import Mirror
from ge_torchrl.refiners.strategy import Strategy
from ge_torchrl.refiners.ties import ties_in
from ge_torchrl.search.archive import START, Contender
from ge_torchrl.search.fitness import measure, training_seeds
from ge_torchrl.search.heats import run_heats
from ge_torchrl.search.imitation import imitations
from ge_torchrl.search.population import Population
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.shapes import MOST_SPLITS, Shapes
from ge_torchrl.seeding import stream
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

STARTS = "dense starts"
"""The purpose that steps of dense starts are counted under."""

# Standard deviation of the first moves; each split's sum and each leaf's values then spread about so far.
_FIRST_STEP: Final = 0.5
# All races together may take this part of what a limit leaves to the search.
_RACES_SHARE: Final = 0.6
# Imitating a rule takes so many times the steps of finding it: into which tree decides more than which rule it is.
_IMITATING: Final = 2
# Trees that show how far features spread, and steps of each.
_PROBING_TREES, _PROBING_STEPS = 16, 250


def dense_starts(problem: Problem, population: Population, generation: int) -> list[Contender]:
    """Return what comes of a race; nothing where no race is due, or where a limit leaves no room for one.

    These are the rules that came to its end or, where the grammar has no sums, trees that imitate the best of them.

    Args:
        problem: What is searched.
        population: Some of its trees show how far features spread in play.
        generation: Number of the generation.

    Raises:
        LimitReachedError: The backend's limit was reached first.
    """
    if not problem.races_in(generation):
        return []
    backend, config, spec = problem.backend, problem.config, problem.backend.spec
    rng = stream(config.seed, f"dense starts, generation {generation}")
    half_range = 0.5 * (spec.action_high.astype(np.float64) - spec.action_low)
    shapes = Shapes(
        spread=_spread(problem, population, rng),
        n_actions=spec.n_actions,
        half_range=np.where(np.isfinite(half_range), half_range, 1.0),
        mirror=problem.mirror,
        oblique=problem.is_oblique or problem.imitates,
        linear=problem.has_linear_leaves,
        most_splits=min(MOST_SPLITS, config.archive.max_nodes),
    )
    # Each race has the same part of what is left.
    with within(backend, 1 - (1 - _RACES_SHARE) ** (1 / config.starts.races)):
        trees = _raced(problem, shapes, rng)
    if not trees:
        return []
    fitness = measure(
        backend,
        Forest.stack(trees),
        training_seeds(config, generation),
        STARTS,
        config.evaluation.std_penalty,
    )
    return [Contender(tree, float(value), START) for tree, value in zip(trees, fitness, strict=True)]


def _raced(problem: Problem, shapes: Shapes, rng: np.random.Generator) -> list[DecisionTree]:
    """Return the best trees of a race or, where the grammar has no sums, trees that imitate the best one."""
    backend, starts, timesteps = (
        problem.backend,
        problem.config.starts,
        problem.config.starts.max_timesteps or 0,
    )
    if not problem.imitates:
        return race(backend, shapes, problem.mirror, starts.count, timesteps, rng)
    with within(backend, 1 / (1 + _IMITATING)):
        rules = race(backend, shapes, problem.mirror, starts.count, timesteps, rng)
    return imitations(problem, rules[0], _IMITATING * timesteps, STARTS, rng) if rules else []


def _spread(problem: Problem, population: Population, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return how far each feature spreads, [D], over what trees of the population see."""
    some = np.flatnonzero(population.forest.valid)[:_PROBING_TREES]
    trees = population.forest.take(some).trees()
    observed = problem.backend.observe(trees, _PROBING_STEPS, rng.spawn(len(trees)), STARTS)
    spread = spread_of(observed.reshape(-1, observed.shape[-1]))
    # What is one number in the mirror has one unit.
    return spread if problem.mirror is None else np.maximum(spread, spread[problem.mirror.feature])


def race(
    backend: Backend,
    shapes: Shapes,
    mirror: Mirror | None,
    n_starts: int,
    timesteps: int,
    rng: np.random.Generator,
) -> list[DecisionTree]:
    """Race dense starts, and return the trees of those that came to its end, the best first.

    Where the backend's limit breaks it off, those come back that were still in it.

    Args:
        backend: Measures trees, and counts its steps.
        shapes: Draws what starts look like.
        mirror: Of the environment, where it has one.
        n_starts: How many starts there are.
        timesteps: Environment steps of the race.
        rng: Of all its randomness.
    """
    in_own_units = replace(shapes, spread=np.ones_like(shapes.spread))
    # Nobody knows which units suit. On LunarLander, whose features are scaled already, four of four starts returned 190
    # or more after 300,000 steps in its own units, and two of seven in units of what falling at random shows.
    strategies = [
        _strategy(backend, shapes if place % 2 else in_own_units, mirror, stream)
        for place, stream in enumerate(rng.spawn(n_starts))
    ]
    return run_heats(backend, strategies, timesteps, STARTS, rng)


def _strategy(backend: Backend, shapes: Shapes, mirror: Mirror | None, rng: np.random.Generator) -> Strategy:
    tree = shapes.draw(rng)
    return Strategy(
        backend,
        tree,
        ties_in(tree, mirror),
        shapes.units(tree),
        _FIRST_STEP,
        STARTS,
        rng,
        from_zero=True,
    )
