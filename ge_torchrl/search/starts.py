"""Dense starts: trees whose splits weigh all features, raced against each other from nothing.

Evolution builds sums term by term, and a sum is worth little before most of its terms are there. So where the grammar
has sums, a search also begins at the other end: with the few splits that a chain of all actions needs, over all
features, their numbers found by an evolution strategy that starts at zero: of every second start in units of how far
features spread, and of the others in the environment's own. Some starts never leave where they begin;
that shows early. So several run side by side, the better ones go on, and the last one is taken: successive halving
(K. Jamieson and A. Talwalkar, "Non-stochastic best arm identification", AISTATS 2016).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import Backend, LimitReachedError
from ge_torchrl.refiners.local_search import spread_of
from ge_torchrl.refiners.mirror import Mirror
from ge_torchrl.refiners.strategy import Strategy
from ge_torchrl.refiners.ties import Ties, ties_of
from ge_torchrl.search.archive import START, Contender
from ge_torchrl.search.fitness import measure, training_seeds
from ge_torchrl.search.population import Population
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.shapes import MOST_SPLITS, Shapes
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

STARTS = "dense starts"
"""The purpose that steps of dense starts are counted under."""

# Standard deviation of the first moves; each split's sum and each leaf's values then spread about so far.
_FIRST_STEP: Final = 0.5
# Of the starts of a race so many go on into each of its rounds, which take such parts of all its steps. Chosen on
# LunarLander.
_GO_ON: Final = (1.0, 0.5, 0.33, 0.0, 0.0)
_PARTS: Final = (0.25, 0.18, 0.22, 0.175, 0.175)
# Episodes that tell after a round who goes on.
_JUDGED_ON: Final = 20
# All races together may take this part of what a limit leaves to the search.
_RACES_SHARE: Final = 0.6
# Trees that show how far features spread, and steps of each.
_PROBING_TREES, _PROBING_STEPS = 16, 250


def dense_starts(problem: Problem, population: Population, generation: int) -> list[Contender]:
    """Return the best trees of a race; none where no race is due, or where a limit leaves no room for one.

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
        oblique=problem.is_oblique,
        linear=problem.has_linear_leaves,
        most_splits=min(MOST_SPLITS, config.archive.max_nodes),
    )
    limit = backend.limit
    if limit is not None:
        # Each race has the same part of what is left.
        part = 1 - (1 - _RACES_SHARE) ** (1 / config.starts.races)
        backend.limit = limit.part(part, backend.steps.total())
    try:
        timesteps = config.starts.max_timesteps or 0
        trees = race(backend, shapes, problem.mirror, config.starts.count, timesteps, rng)
    finally:
        backend.limit = limit
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


def _spread(problem: Problem, population: Population, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return how far each feature spreads, [D], over what trees of the population see."""
    some = np.flatnonzero(population.forest.valid)[:_PROBING_TREES]
    trees = population.forest.take(some).trees()
    observed = problem.backend.observe(trees, _PROBING_STEPS, rng.spawn(len(trees)), STARTS)
    spread = spread_of(observed.reshape(-1, observed.shape[-1]))
    # What is one number in the mirror has one unit.
    return spread if problem.mirror is None else np.maximum(spread, spread[problem.mirror.feature])


@dataclass(frozen=True, eq=False)
class Lane:
    """A start in a race.

    Attributes:
        strategy: Its search.
        last: How its tree did when it was judged last.
    """

    strategy: Strategy
    last: float = -np.inf


class _Purse:
    """What a race may still take: its steps, or fewer where a limit of the backend leaves room for fewer.

    Of a limit in seconds there are as many as the race makes at the speed that it has had so far: it is another for
    each tree, and for each machine's load.
    """

    def __init__(self, backend: Backend, timesteps: int) -> None:
        self._backend, self._timesteps = backend, timesteps
        self._started, self._first = time.perf_counter(), backend.steps.total()

    def left(self) -> float:
        total, now, limit = self._backend.steps.total(), time.perf_counter(), self._backend.limit
        done = total - self._first
        left: float = self._timesteps - done
        if limit is not None and limit.max_env_steps is not None:
            left = min(left, limit.max_env_steps - total)
        if limit is not None and done > 0:
            left = min(left, (limit.deadline - now) * done / (now - self._started))
        return max(0.0, left)


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
    lanes = [
        Lane(_strategy(backend, shapes if place % 2 else in_own_units, mirror, stream))
        for place, stream in enumerate(rng.spawn(n_starts))
    ]
    purse = _Purse(backend, timesteps)
    with suppress(LimitReachedError):
        for heat, share in enumerate(_GO_ON):
            lanes = lanes[: max(1, round(share * n_starts))]
            for place, lane in enumerate(lanes):
                of_what_is_left = _PARTS[heat] / (sum(_PARTS[heat:]) - _PARTS[heat] * place / len(lanes))
                lane.strategy.advance(int(of_what_is_left / len(lanes) * purse.left()))
            lanes = _judged(backend, lanes, rng)
    return [lane.strategy.tree for lane in lanes if lane.strategy.rounds > 0]


def _strategy(backend: Backend, shapes: Shapes, mirror: Mirror | None, rng: np.random.Generator) -> Strategy:
    tree = shapes.draw(rng)
    ties = None if mirror is None else ties_of(tree, mirror)
    return Strategy(
        backend,
        tree,
        Ties.none(len(tree.parameters)) if ties is None else ties,
        shapes.units(tree),
        _FIRST_STEP,
        STARTS,
        rng,
        from_zero=True,
    )


def _judged(backend: Backend, lanes: Sequence[Lane], rng: np.random.Generator) -> list[Lane]:
    """Return the lanes in the order of their returns on new common episodes."""
    if len(lanes) == 1:
        return list(lanes)
    seeds = episode_seeds("training", _JUDGED_ON, rng)
    forests = [Forest.stack([lane.strategy.tree]) for lane in lanes]
    returns = [backend.evaluate(forest, seeds, STARTS).returns.mean() for forest in forests]
    judged = [Lane(lane.strategy, float(mean)) for lane, mean in zip(lanes, returns, strict=True)]
    return sorted(judged, key=lambda lane: -lane.last)
