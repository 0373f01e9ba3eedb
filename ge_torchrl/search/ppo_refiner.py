"""Refinement by PPO: tree -> DDT -> PPO -> tree.

The one room of `search` that imports torch; it is imported only where PPO is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from ge_torchrl.environments.route import Route
from ge_torchrl.refiner_section import PPOConfig
from ge_torchrl.rl.ddt import harden, soften
from ge_torchrl.rl.ppo import PPOSettings, train
from ge_torchrl.rl.samples import open_source
from ge_torchrl.search.fitness import measure
from ge_torchrl.search.refinement import FIRST, Effort, Tuned
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest


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


class PPORefiner:
    """Refines trees of one run.

    Args:
        route: Measures hard trees.
        config: The hyperparameters.
    """

    def __init__(self, route: Route, config: PPOConfig) -> None:
        self._route = route
        self._config = config

    def tune(
        self,
        trees: Sequence[DecisionTree],
        rngs: Sequence[np.random.Generator],
        effort: Effort = FIRST,
    ) -> list[Tuned]:
        """Tune trees one after another, since training uses one thread of the whole process; see `RefinesTrees`."""
        return [self._tune(tree, rng, effort) for tree, rng in zip(trees, rngs, strict=True)]

    def _tune(self, tree: DecisionTree, rng: np.random.Generator, effort: Effort) -> Tuned:
        """Soften a tree, train it with its structure unchanged, and harden it."""
        config, n_actions = self._config, self._route.spec.n_actions
        # A stream of their own: with or without snapshots, training is the same to the bit.
        seeds = episode_seeds("training", effort.factor * config.snapshot_episodes, rng.spawn(1)[0])
        generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
        ddt = soften(
            tree,
            n_actions,
            alpha=config.alpha,
            leaf_sd=config.leaf_sd,
            leaf_scale=config.leaf_scale,
            generator=generator,
        )
        source = open_source(self._route.spec, config.source, rng=rng)
        snapshots = Snapshots(self._route, tree, seeds)
        try:
            training = train(
                ddt,
                source,
                _settings(config, effort.factor * effort.patience),
                seed=int(rng.integers(2**62)),
                after_update=lambda: snapshots.look_at(harden(ddt)),
            )
        finally:
            source.close()
        refined = tree if training.failure is not None else snapshots.chosen
        return Tuned(refined, training, training.timesteps + snapshots.env_steps)


def _settings(config: PPOConfig, factor: int) -> PPOSettings:
    return PPOSettings(
        max_timesteps=factor * config.max_timesteps,
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
        scale_critic=config.scale_critic,
        alpha_final=config.alpha_final,
        lr_thresholds=config.lr_thresholds,
        optimizer=config.optimizer,
        minibatch_size=config.minibatch_size,
        entropy_final=config.entropy_final,
    )
