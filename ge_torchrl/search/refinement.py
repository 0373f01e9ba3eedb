"""Refinement: tree -> DDT -> PPO -> tree, measured before and after on the same unseen episodes.

The one room of `search` that imports torch; it is imported only where PPO is asked for.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from ge_torchrl.environments.route import Route
from ge_torchrl.refinement_section import PPOConfig
from ge_torchrl.rl.ddt import harden, soften
from ge_torchrl.rl.ppo import PPOSettings, TrainingRecord, train
from ge_torchrl.rl.samples import open_source
from ge_torchrl.search.fitness import measure
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest

IMPROVED, NOT_IMPROVED, FAILED = "improved", "not_improved", "failed"


@dataclass(frozen=True, eq=False)
class Refinement:
    """One tree before and after PPO.

    Attributes:
        tree: The hardened tree; the tree as it was if training failed.
        outcome: IMPROVED where it returns more than before on the same episodes, NOT_IMPROVED, or FAILED.
        return_before: Mean return of the tree as it was, on the measuring episodes.
        return_after: Mean return of the hardened tree on the same episodes.
        thresholds_moved: Number of thresholds that changed.
        largest_threshold_move: Largest change of a threshold.
        leaves_changed: Number of leaves whose action changed.
        training: What PPO reports.
        measuring_seeds: [E] int64, the measuring episodes.
        env_steps: Environment steps of measuring, training and snapshots.
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
        """Whether the hardened tree is better than the tree was."""
        return self.outcome == IMPROVED


class RefinesTrees(Protocol):
    """Makes a better tree of a tree, with its structure unchanged."""

    def refine(self, tree: DecisionTree, generation: int, attempt: int = 0) -> Refinement:
        """Refine a tree; generation and attempt name the stream of randomness."""
        ...


class Snapshots:
    """Watches a tree in training and remembers which hard tree to return.

    Without episodes that is the last one; with episodes the one with the best mean return on them, the tree before
    training included and the earlier of equally good ones: a refinement can then only gain on these episodes.

    Args:
        route: Runs the trees.
        before: The tree before training.
        seeds: [E] the episodes, the same for all snapshots; may be empty.

    Attributes:
        chosen: The tree to return.
        env_steps: Environment steps taken.
    """

    def __init__(self, route: Route, before: DecisionTree, seeds: NDArray[np.int64]) -> None:
        self._route = route
        self._seeds = seeds
        self._best = -np.inf
        self.chosen = before
        self.env_steps = 0
        self.look_at(before)

    def look_at(self, tree: DecisionTree) -> None:
        """Compare one more hard tree with the best one so far."""
        if len(self._seeds) == 0:
            self.chosen = tree
            return
        measured = measure(self._route, Forest.stack([tree]), self._seeds)
        self.env_steps += measured.env_steps
        if measured.fitness[0] > self._best:
            self._best, self.chosen = float(measured.fitness[0]), tree


class Refiner:
    """Refines trees of one run.

    Args:
        route: Measures hard trees.
        config: The hyperparameters.
        seed: The run's seed, from which all randomness follows.
    """

    def __init__(self, route: Route, config: PPOConfig, seed: int) -> None:
        self._route = route
        self._config = config
        self._seed = seed
        self._settings = PPOSettings(
            max_timesteps=config.max_timesteps,
            update_timesteps=config.update_timesteps,
            epochs=config.epochs,
            clip_epsilon=config.clip_epsilon,
            gamma=config.gamma,
            gae_lambda=config.gae_lambda,
            lr_actor=config.lr_actor,
            lr_critic=config.lr_critic,
            entropy_coeff=config.entropy_coeff,
            critic_coeff=config.critic_coeff,
            hidden=config.critic_hidden,
            scale_features=config.scale_features,
            alpha_final=config.alpha_final,
            lr_thresholds=config.lr_thresholds,
            optimizer=config.optimizer,
            minibatch_size=config.minibatch_size,
            entropy_final=config.entropy_final,
        )

    def refine(self, tree: DecisionTree, generation: int, attempt: int = 0) -> Refinement:
        """Soften a tree, train it by PPO with its structure unchanged, harden it and measure it anew.

        Args:
            tree: The tree.
            generation: Names the stream of randomness, so that one refinement does not depend on another.
            attempt: Counts the refinements of a generation; names the stream too.
        """
        started = time.perf_counter()
        name = stream_name(generation, attempt)
        rng = stream(self._seed, f"refinement in {name}")
        generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
        ddt = soften(
            tree,
            self._route.spec.n_actions,
            alpha=self._config.alpha,
            leaf_sd=self._config.leaf_sd,
            generator=generator,
        )
        source = open_source(self._route.spec, self._config.source, rng=rng)
        snapshots = self._snapshots_of(tree, f"snapshots in {name}")
        try:
            training = train(
                ddt,
                source,
                self._settings,
                seed=int(rng.integers(2**62)),
                after_update=lambda: snapshots.look_at(harden(ddt)),
            )
        finally:
            source.close()
        refined = tree if training.failure is not None else snapshots.chosen
        seeds = episode_seeds("training", self._config.measuring_episodes, rng)
        env_steps = training.timesteps + snapshots.env_steps
        return compare(self._route, tree, refined, seeds, training, env_steps, started)

    def _snapshots_of(self, tree: DecisionTree, name: str) -> Snapshots:
        # A stream of their own: with or without snapshots, training is the same to the bit.
        rng = stream(self._seed, name)
        return Snapshots(self._route, tree, episode_seeds("training", self._config.snapshot_episodes, rng))


def stream_name(generation: int, attempt: int) -> str:
    """Name one refinement of a run; the first of a generation as if it were the only one."""
    return f"generation {generation}" + (f", attempt {attempt}" if attempt else "")


def compare(
    route: Route,
    before: DecisionTree,
    after: DecisionTree,
    seeds: NDArray[np.int64],
    training: TrainingRecord,
    env_steps: int,
    started: float,
) -> Refinement:
    """Measure a tree before and after on the same unseen episodes, and tell what changed.

    Args:
        route: Runs the trees.
        before: The tree as it was.
        after: The tree of the same structure that came back.
        seeds: [E] the measuring episodes.
        training: What made the one of the other.
        env_steps: Environment steps that this took.
        started: When it began, by `time.perf_counter`.
    """
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
        env_steps=env_steps + measured.env_steps,
        seconds=time.perf_counter() - started,
    )
