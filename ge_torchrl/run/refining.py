"""Who refines the trees of a run: the refiner that its configuration names, and the polish."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ge_torchrl.config import Config
from ge_torchrl.environments.backend import Backend
from ge_torchrl.environments.instances import trees_together
from ge_torchrl.refiners.protocol import FIRST, Effort, Refined, Refiner
from ge_torchrl.run.costs import Rationed
from ge_torchrl.trees.tree import DecisionTree


def refiners_of(config: Config, backend: Backend) -> tuple[Refiner | None, Refiner | None]:
    """Return the refiner and the polisher of a configuration."""
    from ge_torchrl.refiners.local_search import LocalSearch

    polisher = LocalSearch(backend, config.polish, "polish") if config.polish.enabled else None
    if config.refiner.method == "none":
        return None, polisher
    if config.refiner.method == "cmaes":
        return LocalSearch(backend, config.polish, "refinement"), polisher
    return Rationed(_PPO(backend, config), backend, config), polisher


def with_batches(config: Config, backend: Backend) -> Config:
    """Return the configuration with PPO's batches decided, so that it can be repeated where there is other memory."""
    if config.refiner.method != "ppo" or config.refiner.ppo.trees_together is not None:
        return config
    together = trees_together(backend.spec, copied=backend.name != "kernel")
    ppo = replace(config.refiner.ppo, trees_together=together)
    return replace(config, refiner=replace(config.refiner, ppo=ppo))


class _PPO:
    """Refines by PPO. Torch, which takes seconds, is loaded for the first tree: the first generations do not wait."""

    def __init__(self, backend: Backend, config: Config) -> None:
        self._backend, self._config = backend, config
        self._loaded: Refiner | None = None

    def refine(
        self, trees: Sequence[DecisionTree], rngs: Sequence[np.random.Generator], effort: Effort = FIRST
    ) -> list[Refined]:
        """Refine trees; see `Refiner`."""
        if self._loaded is None:
            from ge_torchrl.refiners.rl.refiner import PPORefiner

            self._loaded = PPORefiner(self._backend, self._config.refiner.ppo, "refinement")
        return self._loaded.refine(trees, rngs, effort)
