"""A controller measured on episodes that no run has seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.checks import MOST_EPISODES, MOST_SEED, Rule, checked, refuse
from ge_torchrl.report.evaluated import EvaluationSummary
from ge_torchrl.report.evaluation import evaluate_tree
from ge_torchrl.report.reading import environment_of_tree
from ge_torchrl.report.statistics import Interval, mean_interval
from ge_torchrl.trees.controller import Controller

_EPISODES = Rule("integer", at_least=1, at_most=MOST_EPISODES, because="a return is a mean over episodes")
_SEED = Rule("integer", at_least=0, largest=MOST_SEED, because="seeds of random numbers are not negative")
_ROUTE = Rule("text", choices=("auto", "kernel", "gymnasium"))


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation:
    """What a controller did in test episodes.

    Attributes:
        summary: Mean, deviation, whether the task is solved, and what was run.
        returns: [E] float64, what it returned in each episode.
    """

    summary: EvaluationSummary
    returns: NDArray[np.float64]

    @property
    def mean(self) -> float:
        """Mean return."""
        return self.summary.mean

    @property
    def interval(self) -> Interval:
        """The 95 % interval of the mean."""
        return mean_interval(self.summary.mean, self.summary.std, self.summary.episodes)

    def __repr__(self) -> str:
        low, high = self.interval
        first, *others = self.summary.as_text().splitlines()
        return "\n".join([first, f"95 % interval of the mean: {low:.3f} to {high:.3f}", *others])

    def _repr_markdown_(self) -> str:
        return f"```text\n{self!r}\n```"


def evaluate(
    controller: Controller, *, episodes: int = 1000, seed: int = 10_000, route: str = "auto"
) -> Evaluation:
    """Measure a controller on the episodes that `reset(seed=seed + i)` begins, `i` from 0 to `episodes - 1`.

    >>> import ge_torchrl as ge
    >>> ge.evaluate(ge.load("docs/trees/cartpole_two_decisions.json"), episodes=100)
    CartPole-v1: mean return 500.000 ± 0.000 (min 500, max 500) over 100 episodes
    95 % interval of the mean: 500.000 to 500.000
    seeds 10000 to 10099, kernel route, 2 decision nodes
    SOLVED: the threshold is a mean return of 475

    Args:
        controller: What acts, in the environment that it names.
        episodes: Number of episodes.
        seed: Seed of the first episode.
        route: What steps the environment: "kernel", "gymnasium", or "auto": the kernel where there is one.

    Raises:
        UserError: A value is not allowed, or the environment failed.
    """
    if not isinstance(controller, Controller):
        refuse("controller", controller, "a controller, such as ge.load(path) or result.champion gives")
    episodes = checked("episodes", episodes, _EPISODES)
    seed, route = checked("seed", seed, _SEED), checked("route", route, _ROUTE)
    spec = environment_of_tree(controller)
    return Evaluation(*evaluate_tree(controller.tree, spec, episodes, seed, route))
