"""A controller measured on episodes that no run has seen."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.checks import MOST_EPISODES, MOST_SEED, Rule, checked, refuse
from ge_torchrl.library.keywords import keywords_told
from ge_torchrl.report.evaluated import EvaluationSummary
from ge_torchrl.report.evaluation import evaluate_tree
from ge_torchrl.report.reading import environment_of_tree, read_tree
from ge_torchrl.report.statistics import FEW, Interval, mean_interval
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
        # A few episodes say what they returned, and nothing of others.
        told = [f"95 % interval of the mean: {low:.3f} to {high:.3f}"] * (self.summary.episodes >= FEW)
        return "\n".join([first, *told, *others])

    def _repr_markdown_(self) -> str:
        return f"```text\n{self!r}\n```"


@keywords_told
def evaluate(
    controller: Controller | str | os.PathLike[str],
    *,
    episodes: int = 1000,
    seed: int = 10_000,
    route: str = "auto",
) -> Evaluation:
    """Measure a controller on the episodes that `reset(seed=seed + i)` begins, `i` from 0 to `episodes - 1`.

    >>> import ge_torchrl as ge
    >>> ge.evaluate(ge.load("docs/trees/cartpole_two_decisions.json"), episodes=100)
    CartPole-v1: mean return 500.000 ± 0.000 (min 500, max 500) over 100 episodes
    95 % interval of the mean: 500.000 to 500.000
    seeds 10000 to 10099, kernel route, 2 decision nodes
    SOLVED: the threshold is a mean return of 475

    Args:
        controller: What acts, in the environment that it names; or the path of a tree's file, or of a run's folder,
            whose champion acts in the run's environment.
        episodes: Number of episodes.
        seed: Seed of the first episode.
        route: What steps the environment: "kernel", "gymnasium", or "auto": the kernel where there is one.

    Raises:
        UserError: A value is not allowed, or the environment failed.
    """
    is_path = isinstance(controller, str | os.PathLike)
    if not (is_path or isinstance(controller, Controller)):
        refuse("controller", controller, "a controller, such as result.champion gives, or the path of one")
    episodes = checked("episodes", episodes, _EPISODES)
    seed, route = checked("seed", seed, _SEED), checked("route", route, _ROUTE)
    if isinstance(controller, Controller):
        tree, spec = controller.tree, environment_of_tree(controller)
    else:
        tree, spec = read_tree(Path(controller), nodes=None)
    return Evaluation(*evaluate_tree(tree, spec, episodes, seed, route))
