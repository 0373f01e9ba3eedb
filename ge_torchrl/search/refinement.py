"""Refinement: tree -> DDT -> PPO -> tree, measured before and after on the same unseen episodes.

The one room of `search` that imports torch; it is imported only where PPO is asked for.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import torch

from ge_torchrl.environments.route import Route
from ge_torchrl.rl.ddt import harden, soften
from ge_torchrl.rl.ppo import PPOSettings, TrainingRecord, train
from ge_torchrl.rl.samples import open_source
from ge_torchrl.search.fitness import measure
from ge_torchrl.sections import PPOConfig
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
        env_steps: Environment steps of measuring and training.
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
    env_steps: int
    seconds: float

    @property
    def is_improved(self) -> bool:
        """Whether the hardened tree is better than the tree was."""
        return self.outcome == IMPROVED


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
        )

    def refine(self, tree: DecisionTree, generation: int) -> Refinement:
        """Soften a tree, train it by PPO with its structure unchanged, harden it and measure it anew.

        Args:
            tree: The tree.
            generation: Names the stream of randomness, so that one refinement does not depend on another.
        """
        started = time.perf_counter()
        rng = stream(self._seed, f"refinement in generation {generation}")
        generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
        ddt = soften(
            tree,
            self._route.spec.n_actions,
            alpha=self._config.alpha,
            leaf_sd=self._config.leaf_sd,
            generator=generator,
        )
        source = open_source(self._route.spec, self._config.source, rng=rng)
        try:
            training = train(ddt, source, self._settings, seed=int(rng.integers(2**62)))
        finally:
            source.close()
        refined = tree if training.failure is not None else harden(ddt)
        seeds = episode_seeds("training", self._config.measuring_episodes, rng)
        measured = measure(self._route, Forest.stack([tree, refined]), seeds)
        before, after = (float(fitness) for fitness in measured.fitness)
        outcome = IMPROVED if after > before else NOT_IMPROVED
        moves = np.abs(refined.threshold - tree.threshold)
        return Refinement(
            tree=refined,
            outcome=FAILED if training.failure is not None else outcome,
            return_before=before,
            return_after=after,
            thresholds_moved=int(np.count_nonzero(moves)),
            largest_threshold_move=float(moves.max()),
            leaves_changed=int(np.count_nonzero(refined.action != tree.action)),
            training=training,
            env_steps=measured.env_steps + training.timesteps,
            seconds=time.perf_counter() - started,
        )
