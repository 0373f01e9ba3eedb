"""A route is a way to run trees in an environment; all routes tell one truth (law 5)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest

_Result = TypeVar("_Result")


@dataclass(frozen=True, eq=False)
class Outcomes:
    """What `P` trees did in `E` episodes.

    Attributes:
        returns: [P, E] float64, the return of each episode; NaN for an individual without a tree.
        lengths: [P, E] int64, its number of steps; 0 for an individual without a tree.
    """

    returns: NDArray[np.float64]
    lengths: NDArray[np.int64]

    @classmethod
    def empty(cls, n_trees: int, n_episodes: int) -> Self:
        """Return outcomes of nothing run yet."""
        return cls(
            returns=np.full((n_trees, n_episodes), np.nan), lengths=np.zeros((n_trees, n_episodes), np.int64)
        )

    @property
    def env_steps(self) -> int:
        """Environment steps taken in all episodes together."""
        return int(self.lengths.sum())


class Route(Protocol):
    """Runs trees in one environment. The result of an episode depends on its tree and its seed alone."""

    name: str
    spec: EnvironmentSpec

    def evaluate(self, forest: Forest, seeds: NDArray[np.int64]) -> Outcomes:
        """Run every tree on the episodes that `reset(seed=s)` begins, for each `s` of `seeds` [E]."""
        ...

    def count_visits(self, tree: DecisionTree, seeds: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return [N], how often each node is passed in these episodes, as section 2.4 of the thesis counts."""
        ...

    def observe(self, tree: DecisionTree, n_steps: int, rng: np.random.Generator) -> NDArray[np.float32]:
        """Return [T, D], the observations of a tree's first `n_steps` steps in training episodes that `rng` draws."""
        ...

    def run_jobs(self, jobs: Sequence[Callable[[Route], _Result]]) -> list[_Result]:
        """Run independent jobs, side by side where that pays, each with a route of its own; return their results."""
        ...

    def close(self) -> None:
        """Release threads, processes and environments."""
        ...
