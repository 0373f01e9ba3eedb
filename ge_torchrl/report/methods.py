"""What methods are called: Grammatical Evolution alone, or with trees refined in one way or another."""

from __future__ import annotations

from ge_torchrl.config import Config

GE, GE_PPO, GE_CMAES = "GE", "GE+PPO", "GE+CMA-ES"

# The order in which reports tell of them.
METHODS = (GE_PPO, GE_CMAES, GE)

_BY_REFINER = {"ppo": GE_PPO, "cmaes": GE_CMAES}


def method_of(config: Config) -> str:
    """Return by which method a configuration searches, one of `METHODS`."""
    return _BY_REFINER[config.refiner.method] if config.refiner.enabled else GE


def refiner_of(method: str) -> str:
    """Return what a method refines trees with, such as "PPO"; an empty text for Grammatical Evolution alone."""
    return method.removeprefix(GE).removeprefix("+")
