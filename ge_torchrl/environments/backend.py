"""A backend runs trees in one environment: what it is asked, what it answers, and the ledger of its steps."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.ledger import Accountable, Ledger, Limit, LimitReachedError, within
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.environments.witness import Witness
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

# Who runs trees finds here all that a backend is asked and answers.
__all__ = [
    "Accountable",
    "Backend",
    "Ledger",
    "Limit",
    "LimitReachedError",
    "Outcomes",
    "Sampler",
    "Samples",
    "SoftForest",
    "Trajectory",
    "available_cores",
    "within",
]

_Result = TypeVar("_Result")


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@dataclass(frozen=True, eq=False)
class Outcomes:
    """What `P` trees did in `E` episodes.

    Attributes:
        returns: [P, E] float64, the return of each episode; NaN for an individual without a tree.
        lengths: [P, E] int64, its number of steps; 0 for an individual without a tree.
        leaf_visits: [L] int64, how often each leaf of the forest decided, where that was asked for.
    """

    returns: NDArray[np.float64]
    lengths: NDArray[np.int64]
    leaf_visits: NDArray[np.int64] | None = None

    @classmethod
    def empty(cls, n_trees: int, n_episodes: int, n_leaves: int | None = None) -> Self:
        """Return outcomes of nothing run yet; `n_leaves` of the whole forest where visits are counted."""
        return cls(
            returns=np.full((n_trees, n_episodes), np.nan),
            lengths=np.zeros((n_trees, n_episodes), np.int64),
            leaf_visits=None if n_leaves is None else np.zeros(n_leaves, np.int64),
        )

    @property
    def env_steps(self) -> int:
        """Environment steps taken in all episodes together."""
        return int(self.lengths.sum())


@dataclass(frozen=True, eq=False)
class Trajectory:
    """One episode of one tree, step by step.

    Attributes:
        observations: [T + 1, D] float32, from the reset to what the last step gave.
        actions: [T] int64; [T, A] float32 where an action is values, as the environment was given them.
        rewards: [T] float64.
        terminated: Whether the task ended the episode.
        truncated: Whether the episode reached its limit.
    """

    observations: NDArray[np.float32]
    actions: NDArray[Any]
    rewards: NDArray[np.float64]
    terminated: bool
    truncated: bool


class SoftForest(NamedTuple):
    """`R` trees whose decisions and leaves are random, padded to `M` splits of `K` terms and to `L` leaves.

    A split goes left with probability `sigma(alpha (threshold - sum))`, its sum in float64 in the order of the terms.
    With an infinite `alpha` it is the hard split. Both children of a row of padding are `~0`; so a tree without splits
    stands beside others as leaf 0.

    A leaf draws an action by its probabilities, or values from normal distributions around its own values. The arrays
    of the other kind are empty in all dimensions.

    Attributes:
        feature: [R, M, K] int32, of each term; K is 1 where all trees are axis-aligned, and only there.
        weight: [R, M, K] float64, of each term: 0 for padding, 1 where K is 1.
        threshold: [R, M] float32.
        alpha: [R, M] float64, steepness of each split by one unit of its sum.
        children_left: [R, M] int32, as in `DecisionTree`: a split, or `~leaf`.
        children_right: [R, M] int32, likewise.
        probabilities: [R, L, A] float64, each leaf's probability of each action.
        mean: [R, L, A] float64, each leaf's constants.
        leaf_weight: [R, L, D, A] float64, what one unit of each feature adds to them.
        sd: [R, L, A] float64, standard deviations around the sums.
    """

    feature: NDArray[np.int32]
    weight: NDArray[np.float64]
    threshold: NDArray[np.float32]
    alpha: NDArray[np.float64]
    children_left: NDArray[np.int32]
    children_right: NDArray[np.int32]
    probabilities: NDArray[np.float64]
    mean: NDArray[np.float64]
    leaf_weight: NDArray[np.float64]
    sd: NDArray[np.float64]

    @classmethod
    def with_actions(
        cls,
        feature: NDArray[np.int32],
        threshold: NDArray[np.float32],
        alpha: NDArray[np.float64],
        children_left: NDArray[np.int32],
        children_right: NDArray[np.int32],
        probabilities: NDArray[np.float64],
    ) -> SoftForest:
        """Return axis-aligned trees with actions; `feature` is [R, M], the rest as above."""
        feature = feature[..., np.newaxis]
        return cls(
            feature=feature,
            weight=np.ones(feature.shape),
            threshold=threshold,
            alpha=alpha,
            children_left=children_left,
            children_right=children_right,
            probabilities=probabilities,
            mean=np.zeros((0, 0, 0)),
            leaf_weight=np.zeros((0, 0, 0, 0)),
            sd=np.zeros((0, 0, 0)),
        )

    @property
    def has_actions(self) -> bool:
        """Whether leaves draw actions; if not, they draw values."""
        return self.probabilities.size > 0

    @property
    def n_leaves(self) -> int:
        """Number of leaves of the padded trees, L."""
        return int(max(self.probabilities.shape[1], self.mean.shape[1]))


class Samples(NamedTuple):
    """`T` consecutive steps of each of `R` streams of episodes.

    Attributes:
        observations: [R, T, D] float32, what the action was chosen on.
        actions: [R, T] int64; [R, T, A] float32 where an action is values, as they were drawn: the environment was
            given them clipped.
        rewards: [R, T] float32.
        next_observations: [R, T, D] float32, before any reset.
        terminated: [R, T] bool, the task ended the episode.
        truncated: [R, T] bool, the episode reached its limit.
        episode_returns: [R, T] float32, its rewards so far; the return of the episode where it ends.
    """

    observations: NDArray[np.float32]
    actions: NDArray[Any]
    rewards: NDArray[np.float32]
    next_observations: NDArray[np.float32]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    episode_returns: NDArray[np.float32]

    @classmethod
    def empty(cls, n_trees: int, n_steps: int, n_features: int, n_values: int = 0) -> Samples:
        """Return room for `n_steps` steps of each tree, with actions, or with `n_values` values in place of each."""
        shape = (n_trees, n_steps)
        return cls(
            observations=np.empty((*shape, n_features), np.float32),
            actions=np.empty((*shape, n_values), np.float32) if n_values else np.empty(shape, np.int64),
            rewards=np.empty(shape, np.float32),
            next_observations=np.empty((*shape, n_features), np.float32),
            terminated=np.empty(shape, np.bool_),
            truncated=np.empty(shape, np.bool_),
            episode_returns=np.empty(shape, np.float32),
        )


class Sampler(Protocol):
    """One endless stream of episodes for each of `R` soft trees; an episode that a call cuts goes on in the next."""

    def sample(self, soft: SoftForest, n_steps: int, purpose: str) -> Samples:
        """Take the next `n_steps` steps of each stream, and count them."""
        ...


class Backend(Protocol):
    """Runs trees in one environment. The result of an episode depends on its tree and its seed alone.

    Every call counts its steps in the ledger under its purpose and holds the limit.

    Attributes:
        name: "kernel" or "gymnasium".
        spec: The environment.
        workers: Worker processes that were asked for; 0 leaves it to whoever steps the environment.
        processes: Processes that ran trees so far, as `workers` counts them: 1 is the calling one alone.
        sampling_processes: Likewise, those that stepped it for TorchRL, where they were most; 0 where none did.
        ledger: Where others count the steps that they make in the environment by themselves.
        limit: How far the run may go; None for no limit.
        on_steps: Called with the number of all steps so far, every second or more often while steps are made.
    """

    name: str
    spec: EnvironmentSpec
    workers: int
    processes: int
    sampling_processes: int
    ledger: Ledger
    limit: Limit | None
    on_steps: Callable[[int], None]

    @property
    def steps_per_second(self) -> float:
        """How fast small trees run, measured once when first asked for; not in the ledger."""
        ...

    @property
    def steps(self) -> Counter[str]:
        """Environment steps by purpose."""
        ...

    @property
    def witness(self) -> Witness | None:
        """What was seen of the environment that it had not said of itself; None where it keeps its word."""
        ...

    @property
    def bounds(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Bounds [D], [D] that every observation so far kept: trees may be simplified by them."""
        ...

    def evaluate(
        self, forest: Forest, seeds: NDArray[np.int64], purpose: str, *, visits: bool = False
    ) -> Outcomes:
        """Run every tree on the episodes that `reset(seed=s)` begins, for each `s` of `seeds` [E].

        Trees run as they are: those of a young population are many times faster once they are simplified.

        Raises:
            LimitReachedError: The run is at its limit, or came to it here.
        """
        ...

    def sampler(self, rngs: Sequence[np.random.Generator]) -> Sampler | None:
        """Return streams [R] of training episodes, or None where only TorchRL can sample the environment."""
        ...

    def observe(
        self, trees: Sequence[DecisionTree], n_steps: int, rngs: Sequence[np.random.Generator], purpose: str
    ) -> NDArray[np.float32]:
        """Return [R, T, D], what each tree sees in `n_steps` steps of training episodes that its own rng draws."""
        ...

    def record(self, tree: DecisionTree, seed: int) -> Trajectory:
        """Return one episode, step by step, counted under "record"."""
        ...

    def run_jobs(self, jobs: Sequence[Callable[[Backend], _Result]]) -> list[_Result]:
        """Run independent jobs, side by side where that pays, each with a backend of its own; return their results."""
        ...

    def close(self) -> None:
        """Release threads, processes and environments."""
        ...
