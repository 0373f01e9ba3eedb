"""What methods are called: Grammatical Evolution alone, or with what was added to it."""

from __future__ import annotations

from ge_torchrl.config import Config

GE, THESIS = "GE", "thesis"
_PPO, _CMAES, _POLISH = "GE+PPO", "GE+CMA-ES", "+polish"

METHODS = (THESIS, _PPO + _POLISH, _PPO, _CMAES, GE + _POLISH, GE)
"""All methods, in the order in which reports tell of them."""


def method_of(config: Config) -> str:
    """Return by which method a configuration searches, one of `METHODS`."""
    polish = _POLISH if config.polish.enabled else ""
    match config.refiner.method:
        case "cmaes":
            # Its search is that of the polish, so that a polish beside it is nothing of its own.
            return _CMAES
        case "ppo":
            return THESIS if _is_thesis(config) else _PPO + polish
        case _:
            return GE + polish


def refiner_of(method: str) -> str:
    """Return what refines trees besides any polish, such as "PPO"; an empty text where nothing does."""
    return "PPO" if method == THESIS else method.removesuffix(_POLISH).removeprefix(GE).removeprefix("+")


def added_by(method: str) -> str:
    """Return what a method adds to Grammatical Evolution, such as "PPO and polish"; an empty text for GE alone."""
    return "PPO" if method == THESIS else method.removeprefix(GE).removeprefix("+").replace("+", " and ")


def done_by(method: str, refined: int, polished: int) -> str:
    """Return by which method a run searched in the end, and what it did not come to.

    Args:
        method: One of `METHODS`, as it was set.
        refined: How many trees its refiner refined.
        polished: How many trees were polished.

    Returns:
        Such as "GE+PPO", or "GE+polish; PPO refined no tree" of GE+PPO+polish whose PPO was never due.
    """
    refiner, done, idle = refiner_of(method), method, []
    if refiner and not refined:
        done = done.replace(method.removesuffix(_POLISH), GE)
        idle.append(f"{refiner} refined no tree")
    if method.endswith(_POLISH) and not polished:
        done = done.removesuffix(_POLISH)
        idle.append("no tree was polished")
    return "; ".join([done, *idle])


def _is_thesis(config: Config) -> bool:
    """Tell whether nothing is added to PPO on individuals, and fitness alone selects."""
    return not config.archive.enabled and not config.polish.enabled and config.ge.parsimony == "none"
