"""Refinement by PPO: trees -> DDT -> PPO -> trees, many side by side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from ge_torchrl.config import PPOConfig
from ge_torchrl.environments.backend import Backend
from ge_torchrl.environments.instances import trees_together
from ge_torchrl.refiners.protocol import FIRST, Effort, Refined
from ge_torchrl.refiners.rl.actor_critic import SoftTrees, ValueNetworks, make_actor
from ge_torchrl.refiners.rl.ddt import soften
from ge_torchrl.refiners.rl.gaussian import soften_values
from ge_torchrl.refiners.rl.ppo import train
from ge_torchrl.refiners.rl.samples import open_source
from ge_torchrl.refiners.rl.snapshots import Snapshots
from ge_torchrl.trees.tree import DecisionTree


class PPORefiner:
    """Refines trees of one run; see `Refiner`.

    Args:
        backend: Samples soft trees, where it can, and measures hard ones.
        config: The hyperparameters.
        purpose: What the backend counts the steps under.
    """

    def __init__(self, backend: Backend, config: PPOConfig, purpose: str) -> None:
        self._backend = backend
        self._config = config
        self._purpose = purpose

    def refine(
        self,
        trees: Sequence[DecisionTree],
        rngs: Sequence[np.random.Generator],
        effort: Effort = FIRST,
    ) -> list[Refined]:
        """Refine trees side by side, each as if it were alone; see `Refiner`.

        Which trees make one batch depends on their places in the list and on the size of the environment alone, and so
        do the bits of the result.
        """
        refined: list[Refined] = []
        together = self._config.trees_together
        if together is None:
            together = trees_together(self._backend.spec, copied=self._backend.name != "kernel")
        for first in range(0, len(trees), together):
            chunk = slice(first, first + together)
            refined += self._refine(trees[chunk], rngs[chunk], effort)
        return refined

    def _refine(
        self, trees: Sequence[DecisionTree], rngs: Sequence[np.random.Generator], effort: Effort
    ) -> list[Refined]:
        """Soften trees, train them with their structures unchanged, and harden them."""
        config, spec = self._config, self._backend.spec
        generators = [torch.Generator().manual_seed(int(rng.integers(2**62))) for rng in rngs]
        ddt = self._softened(trees, generators)
        actor = make_actor(ddt)
        networks = ValueNetworks(spec.n_features, config.critic_hidden, generators)
        snapshots = Snapshots(
            self._backend, ddt, round(effort.factor * config.snapshot_episodes), self._purpose
        )
        source = open_source(self._backend, ddt, actor, rngs, self._purpose)
        try:
            max_timesteps = round(effort.factor * effort.patience * config.max_timesteps)
            # Gradient steps of large batches take seconds: the backend says meanwhile that the run goes on.
            check = self._backend.ledger.check
            records = train(ddt, actor, networks, source, config, max_timesteps, snapshots.look, check)
        finally:
            source.close()
        return [
            Refined(before if record.failure is not None else after, record)
            for before, after, record in zip(trees, snapshots.trees(), records, strict=True)
        ]

    def _softened(self, trees: Sequence[DecisionTree], generators: Sequence[torch.Generator]) -> SoftTrees:
        config, spec = self._config, self._backend.spec
        if spec.is_continuous:
            return soften_values(
                trees,
                spec.n_features,
                (spec.action_low, spec.action_high),
                alpha=config.alpha,
                straight_through=config.straight_through,
            )
        return soften(
            trees,
            spec.n_actions,
            alpha=config.alpha,
            leaf_logit=config.leaf_logit,
            generators=generators,
            straight_through=config.straight_through,
        )
