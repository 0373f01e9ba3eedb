"""What methods are called: Grammatical Evolution alone, or with what was added to it."""

from __future__ import annotations

from ge_torchrl.config import Config

GE, THESIS = "GE", "thesis"
_POLISH = "+polish"
_REFINERS = {"none": "", "ppo": "PPO", "cmaes": "CMA-ES"}

METHODS = (
    THESIS,
    *(f"{GE}+{name}{polish}" for name in ("PPO", "CMA-ES") for polish in (_POLISH, "")),
    f"{GE}{_POLISH}",
    GE,
)
"""All methods, in the order in which reports tell of them."""


def method_of(config: Config) -> str:
    """Return by which method a configuration searches, one of `METHODS`."""
    if _is_thesis(config):
        return THESIS
    refiner = _REFINERS[config.refiner.method]
    return f"{GE}{'+' * bool(refiner)}{refiner}{_POLISH * (config.polish.every is not None)}"


def refiner_of(method: str) -> str:
    """Return what refines trees by gradients or by search, such as "PPO"; an empty text where nothing does."""
    return "PPO" if method == THESIS else added_by(method).removesuffix("polish").removesuffix(" and ")


def added_by(method: str) -> str:
    """Return what a method adds to Grammatical Evolution, such as "PPO and polish"; an empty text for GE alone."""
    return "PPO" if method == THESIS else method.removeprefix(GE).removeprefix("+").replace("+", " and ")


def _is_thesis(config: Config) -> bool:
    """Tell whether PPO refines individuals alone, of a selection without parsimony, and nothing else is done."""
    keeps_to_it = not config.archive.keep and config.polish.every is None and config.ge.parsimony == "none"
    return keeps_to_it and config.refiner.method == "ppo"
