"""Refinement of one tree, whatever the method: accepted or not, and measured on unseen episodes."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.route import Route
from ge_torchrl.records import TrainingRecord
from ge_torchrl.refiner_section import RefinerConfig
from ge_torchrl.search.fitness import measure
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest

IMPROVED, NOT_IMPROVED, FAILED = "improved", "not_improved", "failed"


@dataclass(frozen=True, eq=False)
class Refinement:
    """One tree before and after its refinement.

    Attributes:
        tree: The refined tree; the tree as it was if training failed or the result was not accepted.
        outcome: IMPROVED where it returns more than before on the same episodes, NOT_IMPROVED, or FAILED.
        return_before: Mean return of the tree as it was, on the measuring episodes.
        return_after: Mean return of the refined tree on the same episodes.
        thresholds_moved: Number of thresholds that changed.
        largest_threshold_move: Largest change of a threshold.
        leaves_changed: Number of leaves whose action changed.
        training: What the method reports.
        measuring_seeds: [E] int64, the measuring episodes.
        env_steps: Environment steps of tuning, acceptance and measuring.
        seconds: Clock time.
    """

    tree: DecisionTree
    outcome: str
    return_before: float
    return_after: float
    thresholds_moved: int
    largest_threshold_move: float
    leaves_changed: int
    training: TrainingRecord
    measuring_seeds: NDArray[np.int64]
    env_steps: int
    seconds: float

    @property
    def is_improved(self) -> bool:
        """Whether the refined tree is better than the tree was."""
        return self.outcome == IMPROVED


@dataclass(frozen=True)
class Effort:
    """How much more than in a first refinement is spent on a tree.

    Attributes:
        factor: How many times the method's episodes, and its steps in the environment.
        patience: How many times the steps beyond that, so that so many times more trees can be tried.
        step: How many times the first step of thresholds, where a method has one: a tree that is good already is
            searched nearer by.
    """

    factor: int = 1
    patience: int = 1
    step: float = 1.0


FIRST = Effort()


@dataclass(frozen=True, eq=False)
class Tuned:
    """What a method made of a tree.

    Attributes:
        tree: The tree, its structure unchanged; as it was if training failed.
        training: What it took.
        env_steps: Environment steps, snapshots included.
    """

    tree: DecisionTree
    training: TrainingRecord
    env_steps: int


class RefinesTrees(Protocol):
    """Makes better trees of trees, with their structure unchanged."""

    def tune(
        self,
        trees: Sequence[DecisionTree],
        rngs: Sequence[np.random.Generator],
        effort: Effort = FIRST,
    ) -> list[Tuned]:
        """Tune trees, each by itself.

        Args:
            trees: The trees.
            rngs: A stream of randomness for each.
            effort: How much more than in a first refinement.

        Returns:
            What became of each.
        """
        ...


def refine(
    refiner: RefinesTrees, route: Route, tree: DecisionTree, config: RefinerConfig, seed: int, name: str
) -> Refinement:
    """Tune a tree, accept the result or not, and measure it anew.

    Args:
        refiner: The method.
        route: Runs trees.
        tree: The tree.
        config: How a refined tree is accepted and measured.
        seed: The run's seed, from which all randomness follows.
        name: Of the stream of randomness, so that one refinement does not depend on another.
    """
    started = time.perf_counter()
    rng = stream(seed, name)
    (tuned,) = refiner.tune([tree], [rng])
    after, env_steps = tuned.tree, tuned.env_steps
    if config.acceptance_episodes > 0 and after != tree:
        seeds = episode_seeds("training", config.acceptance_episodes, rng)
        outcomes = route.evaluate(Forest.stack([tree, after]), seeds)
        env_steps += outcomes.env_steps
        if not is_clearly_better(outcomes.returns[1], outcomes.returns[0], config.acceptance_errors):
            after = tree
    seeds = episode_seeds("training", config.measuring_episodes, rng)
    return _compare(route, tree, replace(tuned, tree=after, env_steps=env_steps), seeds, started)


def is_clearly_better(returns: NDArray[np.float64], than: NDArray[np.float64], errors: float) -> bool:
    """Tell whether a tree returns more than another by so many standard errors of the mean difference.

    With the differences d_e of `E` episodes and k errors: `mean(d) > k std(d) / sqrt(E)`.

    Args:
        returns: [E] of the tree.
        than: [E] of the other on the same episodes.
        errors: k, at least 0.
    """
    difference = returns - than
    return bool(difference.mean() > errors * difference.std() / math.sqrt(len(difference)))


def stream_name(generation: int, attempt: int) -> str:
    """Name one refinement of a run; the first of a generation as if it were the only one."""
    return f"refinement in generation {generation}" + (f", attempt {attempt}" if attempt else "")


def _compare(
    route: Route, before: DecisionTree, tuned: Tuned, seeds: NDArray[np.int64], started: float
) -> Refinement:
    """Measure a tree before and after on the same unseen episodes, and tell what changed."""
    after, training = tuned.tree, tuned.training
    measured = measure(route, Forest.stack([before, after]), seeds)
    return_before, return_after = (float(fitness) for fitness in measured.fitness)
    outcome = IMPROVED if return_after > return_before else NOT_IMPROVED
    moves = np.abs(after.threshold - before.threshold)
    return Refinement(
        tree=after,
        outcome=FAILED if training.failure is not None else outcome,
        return_before=return_before,
        return_after=return_after,
        thresholds_moved=int(np.count_nonzero(moves)),
        largest_threshold_move=float(moves.max()),
        leaves_changed=int(np.count_nonzero(after.action != before.action)),
        training=training,
        measuring_seeds=seeds,
        env_steps=tuned.env_steps + measured.env_steps,
        seconds=time.perf_counter() - started,
    )
