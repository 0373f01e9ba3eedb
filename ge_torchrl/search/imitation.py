"""Imitation: a tree of the grammar does what a rule does that the grammar cannot say.

A rule of a few weighted sums is found sooner than an axis-aligned tree that is as good. So the tree is fitted to what
the rule would do, in the states that trees fitted before came into; a state counts by how clear the rule's choice is
there. What comes of it is seldom good, but near to what is: an evolution strategy moves its thresholds. It is larger
than it may be at first, and loses one split after another.

Sources: S. Ross, G. Gordon and D. Bagnell, "A reduction of imitation learning and structured prediction to no-regret
online learning", AISTATS 2011 (DAgger); O. Bastani, Y. Pu and A. Solar-Lezama, "Verifiable reinforcement learning via
policy extraction", NeurIPS 2018, for the weights.
"""

from __future__ import annotations

import sys
import time
from contextlib import suppress
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import LimitReachedError, within
from ge_torchrl.ge.encoding import can_derive
from ge_torchrl.refiners.folding import fold_at, whole_of
from ge_torchrl.refiners.mirror import Mirror
from ge_torchrl.search.heats import run_heats
from ge_torchrl.search.neighbours import features_of, folds
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.refinement import snapped
from ge_torchrl.search.shortening import moved, shortened, strategy_of
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.fitting import Examples, fit
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.nodes import Nodes, forest_of
from ge_torchrl.trees.simplify import simplify
from ge_torchrl.trees.tree import DecisionTree, FloatArray

# Rounds of fitting; each brings so many states, of so many trees. A fit is to so many states at most, and to fewer of
# many features.
_ROUNDS: Final = 30
_STATES, _EXPLORERS, _MOST_EXAMPLES, _MOST_NUMBERS = 1500, 3, 16_000, 1_000_000
# Trees are fitted so many times as large as they may be, and shortened, where there are so many steps for it.
_LARGER, _STEPS_TO_SHORTEN = 2, 1_000_000
# Parts of all steps: for fitting, for the heats, and for shortening; the thresholds of what is left have the rest.
_FITTING, _HEATS, _SHORTENING = 0.2, 0.35, 0.3
# Episodes of each tree in its round, and of the best of all rounds.
_EPISODES, _JUDGED, _JUDGED_ON = 10, 16, 40
# So many of these go into the heats, their first moves so large in units of how far features spread.
_STARTS, _FIRST_STEP = 6, 0.15
_TINY: Final = 1e-12


def imitations(
    problem: Problem, rule: DecisionTree, timesteps: int, purpose: str, rng: np.random.Generator
) -> list[DecisionTree]:
    """Return trees of the grammar that imitate a rule, their thresholds moved where they return most, the best first.

    Where the backend's limit breaks it off, what there is comes back. What the grammar does not say is left out.

    Args:
        problem: What is searched; its grammar has actions, and splits of one feature.
        rule: Who shows what to do.
        timesteps: Environment steps of all; fewer where the backend's limit leaves room for fewer.
        purpose: What the backend counts them under.
        rng: Of all randomness.
    """
    backend, largest = problem.backend, _largest(problem)
    first, found = backend.steps.total(), []
    timesteps = min(timesteps, _left(problem))
    with within(backend, _FITTING):
        fitted = _fitted(problem, rule, timesteps, purpose, rng)
    with suppress(LimitReachedError):
        # What is left where all else is broken off.
        found = [tree for tree in fitted if tree.num_decision_nodes <= largest][:1]
        best = fitted[:_STARTS]
        strategies = [
            strategy_of(problem, tree, _FIRST_STEP, purpose, stream)
            for tree, stream in zip(best, rng.spawn(len(best)), strict=True)
        ]
        if strategies:
            with within(backend, _HEATS / (1 - _FITTING)):
                tree, *_ = run_heats(backend, strategies, int(_HEATS * timesteps), purpose, rng) or best
            tree = shortened(problem, tree, largest, int(_SHORTENING * timesteps), purpose, rng)
            found = [tree]
            left = timesteps - (backend.steps.total() - first)
            found = [moved(problem, tree, left, _FIRST_STEP, purpose, rng)]
    said = (snapped(problem, tree) for tree in found)
    return [tree for tree in said if can_derive(tree, problem.tables)]


def _largest(problem: Problem) -> int:
    """Return how many splits a tree may have: what is kept, and what the grammar can say."""
    return int(min(problem.config.archive.max_nodes, problem.tables.grammar.most_splits))


def _left(problem: Problem) -> int:
    """Return about how many environment steps the backend's limit leaves; of seconds as at the speed of before."""
    limit, speed = problem.backend.limit, problem.config.evaluation.steps_per_second or 0.0
    if limit is None:
        return sys.maxsize
    most = sys.maxsize if limit.max_env_steps is None else limit.max_env_steps - problem.backend.steps.total()
    seconds = limit.deadline - time.perf_counter()
    return max(1, min(most, int(min(seconds * speed, sys.maxsize))))


def _fitted(
    problem: Problem, rule: DecisionTree, timesteps: int, purpose: str, rng: np.random.Generator
) -> list[DecisionTree]:
    """Return the best trees of all rounds, the best first."""
    backend, first = problem.backend, problem.backend.steps.total()
    most = int(_FITTING * timesteps)
    n_states = max(1, min(_STATES, most // _ROUNDS))
    size = _largest(problem) * (_LARGER if timesteps >= _STEPS_TO_SHORTEN else 1)
    tried: list[tuple[float, DecisionTree]] = []
    with suppress(LimitReachedError):
        (seen,) = backend.observe([rule], n_states, rng.spawn(1), purpose)
        for number in range(_ROUNDS):
            trees = _fits(problem, rule, seen, size, rng, weighted=number % 2 == 0)
            returns = _returns(problem, trees, _EPISODES, purpose, rng)
            tried += zip(returns.tolist(), trees, strict=True)
            if backend.steps.total() - first > most:
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
    problem: Problem,
    rule: DecisionTree,
    seen: FloatArray,
    size: int,
    rng: np.random.Generator,
    *,
    weighted: bool,
) -> list[DecisionTree]:
    """Return trees of a size that are fitted to what the rule does; in a mirror one is folded at each feature."""
    most = min(_MOST_EXAMPLES, _MOST_NUMBERS // seen.shape[1])
    if len(seen) > most:
        seen = seen[rng.choice(len(seen), most, replace=False)]
    weights = clearness(rule, seen) if weighted else np.ones(len(seen))
    examples = Examples(seen, rule.decide(seen).astype(np.int64), weights)
    features, mirror = features_of(problem).tolist(), problem.mirror
    fitted: list[Nodes] = []
    if mirror is not None and folds(problem):
        for feature in filter(mirror.changes_sign, features):
            folded = _folded(examples, feature, mirror)
            whole = whole_of(fold_at(feature, fit(folded, features, (size - 1) // 2), mirror), mirror)
            fitted += [] if whole is None else [whole]
    fitted = fitted or [fit(examples, features, size)]
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
