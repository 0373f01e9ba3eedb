"""Imitation: a tree of the grammar does what a rule does that the grammar cannot say.

A rule of a few weighted sums is found sooner than an axis-aligned tree that is as good. So the tree is fitted to what
the rule would do, in the states that trees fitted before came into; a state counts by how clear the rule's choice is
there. What comes of it is seldom good, but near to what is: an evolution strategy then moves its thresholds.

Sources: S. Ross, G. Gordon and D. Bagnell, "A reduction of imitation learning and structured prediction to no-regret
online learning", AISTATS 2011 (DAgger); O. Bastani, Y. Pu and A. Solar-Lezama, "Verifiable reinforcement learning via
policy extraction", NeurIPS 2018, for the weights.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import LimitReachedError, within
from ge_torchrl.refiners.folding import fold_at, whole_of
from ge_torchrl.refiners.local_search import spread_of
from ge_torchrl.refiners.mirror import Mirror
from ge_torchrl.refiners.strategy import Strategy
from ge_torchrl.refiners.ties import Ties, ties_of
from ge_torchrl.search.heats import run_heats
from ge_torchrl.search.neighbours import features_of, folds
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.refinement import snapped
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.fitting import Examples, fit
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.nodes import Nodes, forest_of
from ge_torchrl.trees.simplify import simplify
from ge_torchrl.trees.tree import DecisionTree, FloatArray

# Rounds of fitting; each brings so many states, of so many trees. A fit is to so many states at most.
_ROUNDS: Final = 12
_STATES, _EXPLORERS, _MOST_EXAMPLES = 4000, 3, 16_000
# Parts of the largest size that fits have.
_SIZES: Final = (1.0, 0.7)
# The part of all steps that goes to fitting.
_FITTING_SHARE: Final = 0.3
# Episodes of each tree in its round, and of the best of all rounds.
_EPISODES, _JUDGED, _JUDGED_ON = 10, 16, 30
_TINY: Final = 1e-12
# So many of these go into the heats, their first moves so large in units of how far features spread over such states.
_STARTS, _FIRST_STEP, _SPREAD_OVER = 8, 0.2, 1000


def imitations(
    problem: Problem, rule: DecisionTree, timesteps: int, purpose: str, rng: np.random.Generator
) -> list[DecisionTree]:
    """Return trees of the grammar that imitate a rule, their thresholds moved where they return most, the best first.

    Where the backend's limit breaks it off, what there is comes back.

    Args:
        problem: What is searched; its grammar has actions, and splits of one feature.
        rule: Who shows what to do.
        timesteps: Environment steps of all; fewer where the backend's limit leaves room for fewer.
        purpose: What the backend counts them under.
        rng: Of all randomness.
    """
    backend = problem.backend
    first = backend.steps.total()
    with within(backend, _FITTING_SHARE):
        fitted = _fitted(problem, rule, int(_FITTING_SHARE * timesteps), purpose, rng)
    found = fitted[:1]
    with suppress(LimitReachedError):
        starts = zip(fitted[:_STARTS], rng.spawn(_STARTS), strict=False)
        strategies = [_strategy(problem, tree, purpose, stream) for tree, stream in starts]
        if strategies:
            left = timesteps - (backend.steps.total() - first)
            found = run_heats(backend, strategies, left, purpose, rng) or found
    return [snapped(problem, tree) for tree in found]


def _strategy(problem: Problem, tree: DecisionTree, purpose: str, rng: np.random.Generator) -> Strategy:
    (observed,) = problem.backend.observe([tree], _SPREAD_OVER, [rng], purpose)
    ties = None if problem.mirror is None else ties_of(tree, problem.mirror)
    return Strategy(
        problem.backend,
        tree,
        Ties.none(len(tree.parameters)) if ties is None else ties,
        tree.parameter_units(spread_of(observed)),
        _FIRST_STEP,
        purpose,
        rng,
    )


def _fitted(
    problem: Problem, rule: DecisionTree, timesteps: int, purpose: str, rng: np.random.Generator
) -> list[DecisionTree]:
    """Return the best trees of all rounds, the best first."""
    backend, first = problem.backend, problem.backend.steps.total()
    n_states = max(1, min(_STATES, timesteps // _ROUNDS))
    tried: list[tuple[float, DecisionTree]] = []
    with suppress(LimitReachedError):
        (seen,) = backend.observe([rule], n_states, rng.spawn(1), purpose)
        for number in range(_ROUNDS):
            trees = _fits(problem, rule, seen, rng, weighted=number % 2 == 0)
            returns = _returns(problem, trees, _EPISODES, purpose, rng)
            tried += zip(returns.tolist(), trees, strict=True)
            if backend.steps.total() - first > timesteps:
                break
            explorers = [trees[i] for i in np.argsort(-returns, kind="stable")[:_EXPLORERS]]
            more = backend.observe(
                explorers, -(-n_states // len(explorers)), rng.spawn(len(explorers)), purpose
            )
            seen = np.concatenate([seen, more.reshape(-1, seen.shape[1])])
    tried.sort(key=lambda one: -one[0])
    best = list(dict.fromkeys(tree for _, tree in tried))[:_JUDGED]
    with suppress(LimitReachedError):
        if len(best) > 1:
            returns = _returns(problem, best, _JUDGED_ON, purpose, rng)
            best = [best[i] for i in np.argsort(-returns, kind="stable")]
    return best


def _fits(
    problem: Problem, rule: DecisionTree, seen: FloatArray, rng: np.random.Generator, *, weighted: bool
) -> list[DecisionTree]:
    """Return trees of several sizes, fitted to what the rule does; in a mirror folded at each feature that can be."""
    if len(seen) > _MOST_EXAMPLES:
        seen = seen[rng.choice(len(seen), _MOST_EXAMPLES, replace=False)]
    weights = clearness(rule, seen) if weighted else np.ones(len(seen))
    examples = Examples(seen, rule.decide(seen).astype(np.int64), weights)
    features, mirror = features_of(problem).tolist(), problem.mirror
    sizes = [max(1, round(part * problem.config.archive.max_nodes)) for part in _SIZES]
    fitted: list[Nodes] = []
    if mirror is not None and folds(problem):
        for feature in filter(mirror.changes_sign, features):
            folded = _folded(examples, feature, mirror)
            halves = (fold_at(feature, fit(folded, features, (size - 1) // 2), mirror) for size in sizes)
            fitted += [whole for half in halves if (whole := whole_of(half, mirror)) is not None]
    fitted = fitted or [fit(examples, features, size) for size in sizes]
    return simplify(forest_of(fitted), *problem.backend.bounds).trees()


def _folded(examples: Examples, feature: int, mirror: Mirror) -> Examples:
    """Return examples as half of a tree sees them that is folded at a feature."""
    turned = examples.observations[:, feature] < 0
    return Examples(
        np.where(turned[:, np.newaxis], mirror.observations(examples.observations), examples.observations),
        np.where(turned, mirror.answers(examples.actions), examples.actions),
        examples.weights,
    )


def _returns(
    problem: Problem, trees: list[DecisionTree], n_episodes: int, purpose: str, rng: np.random.Generator
) -> NDArray[np.float64]:
    seeds = episode_seeds("training", n_episodes, rng)
    mean: NDArray[np.float64] = problem.backend.evaluate(Forest.stack(trees), seeds, purpose).returns.mean(
        axis=1
    )
    return mean


def clearness(rule: DecisionTree, observations: FloatArray) -> NDArray[np.float64]:
    """Return how clear a rule's choice is in each state, [T]: how far sums on its path are from their thresholds.

    The nearest one counts. What is far is told by each split's average.

    Args:
        rule: The rule.
        observations: [T, D] float32.
    """
    arrays = rule.arrays
    clear = np.full(len(observations), np.inf)
    node = np.full(len(observations), 0 if rule.num_decision_nodes else -1)
    for split in range(rule.num_decision_nodes):
        terms = slice(arrays.term_start[split], arrays.term_start[split + 1])
        sums = observations[:, arrays.feature[terms]].astype(np.float64) @ arrays.weight[terms].astype(
            np.float64
        )
        beyond = sums - float(arrays.threshold[split])
        here = node == split
        distance = np.abs(beyond[here])
        clear[here] = np.minimum(
            clear[here], distance / max(distance.mean(), _TINY) if here.any() else distance
        )
        node[here] = np.where(beyond[here] < 0, arrays.children_left[split], arrays.children_right[split])
    return np.where(np.isfinite(clear), clear, 1.0)
