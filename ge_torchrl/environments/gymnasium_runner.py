"""One process plays episodes of a Gymnasium environment, one after another, without a NumPy call of our own a step."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import Ledger, Trajectory
from ge_torchrl.environments.border import Border, Witness
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.trees.forest import Forest, ForestArrays

# A limit or a sign of life is looked after this often [s].
_LOOK_SECONDS = 0.25

# A leaf's number, or (feature, threshold, left, right); where splits are sums, the feature is ((feature, weight), ...).
_Node: TypeAlias = int | tuple[Any, float, Any, Any]


@dataclass(frozen=True, eq=False)
class Jobs:
    """Episodes to play: tree `tree[j]` of a forest on the episode of `seed[j]`, both [J]; trees in their order."""

    tree: NDArray[np.int64]
    seed: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.seed)


@dataclass(frozen=True, eq=False)
class Played:
    """What came of `Jobs`: returns and lengths, both [J], and the visits of the forest's leaves [L]."""

    returns: NDArray[np.float64]
    lengths: NDArray[np.int64]
    leaf_visits: NDArray[np.int64]


class Watch(Protocol):
    """Is told of steps, and may end the work by raising.

    Attributes:
        due: When to look next, on the clock of `time.perf_counter` [s].
        allowance: After how many steps to look at the latest.
    """

    due: float
    allowance: float

    def look(self, n_steps: int) -> None:
        """Count steps made since the last look; raise where work is to end."""
        ...

    def count(self, n_steps: int) -> None:
        """Count the last steps of a call, which may have ended by an error."""
        ...


class LedgerWatch:
    """Writes into the ledger of a backend and holds its limit.

    Args:
        ledger: Of the backend.
        purpose: Under which steps are counted.
    """

    def __init__(self, ledger: Ledger, purpose: str) -> None:
        self._ledger, self._purpose = ledger, purpose
        ledger.check()
        self._plan()

    def look(self, n_steps: int) -> None:
        """Count steps, and look whether the limit is passed; see `Watch`."""
        self.count(n_steps)
        # At the very last allowed step this call may be at its end: whether it is, the next call's check tells.
        if self._ledger.steps_left != 0:
            self._ledger.check()
        self._plan()

    def count(self, n_steps: int) -> None:
        """Count steps; see `Watch`."""
        self._ledger.count(self._purpose, n_steps)

    def _plan(self) -> None:
        limit = self._ledger.limit
        self.due = min(time.perf_counter() + _LOOK_SECONDS, math.inf if limit is None else limit.deadline)
        self.allowance = self._ledger.steps_left + 1


class Runner:
    """Plays trees in one environment, which is made when it is first needed.

    The result of an episode depends on its tree and its seed alone, as far as `reset(seed=...)` of the environment
    makes it so.

    Args:
        spec: The environment.
    """

    def __init__(self, spec: EnvironmentSpec) -> None:
        self.spec = spec
        self.witness = Witness(spec)
        self._border: Border | None = None

    @property
    def border(self) -> Border:
        """The environment."""
        if self._border is None:
            self._border = Border(self.spec, self.witness)
        return self._border

    def play(self, forest: Forest, jobs: Jobs, watch: Watch) -> Played:
        """Play all jobs."""
        arrays = forest.arrays
        played = Played(np.zeros(len(jobs)), np.zeros(len(jobs), np.int64), np.zeros(len(arrays.action), np.int64))
        edges = [*np.flatnonzero(np.diff(jobs.tree, prepend=-1)).tolist(), len(jobs)]
        for first, end in itertools.pairwise(edges):
            tree = int(jobs.tree[first])
            player = _Player(self.border, arrays, tree, watch)
            for j in range(first, end):
                played.returns[j], played.lengths[j] = player.episode(int(jobs.seed[j]))
            played.leaf_visits[arrays.leaf_start[tree] : arrays.leaf_start[tree + 1]] += player.visits
        return played

    def observe(
        self, forest: Forest, tree: int, seeds: Sequence[int], n_steps: int, watch: Watch
    ) -> NDArray[np.float32]:
        """Return what a tree sees in its first `n_steps` steps, or fewer where the episodes of `seeds` have fewer."""
        player = _Player(self.border, forest.arrays, tree, watch)
        seen: list[list[float]] = []
        for seed in seeds:
            if len(seen) == n_steps:
                break
            player.episode(seed, seen, n_steps - len(seen))
        return np.array(seen, np.float32).reshape(len(seen), self.spec.n_features)

    def record(self, forest: Forest, seed: int, watch: Watch) -> Trajectory:
        """Return an episode of the forest's only tree, step by step."""
        player = _Player(self.border, forest.arrays, 0, watch)
        observation = self.border.reset(seed)
        observations, actions, rewards = [observation], [], []
        terminated = truncated = False
        try:
            while not (terminated or truncated):
                action = player.decide(observation)
                observation, reward, terminated, truncated = self.border.step(action)
                observations.append(observation)
                actions.append(action)
                rewards.append(reward)
        finally:
            watch.count(len(actions))
        return Trajectory(
            np.array(observations, np.float32),
            np.array(actions, np.int64),
            np.array(rewards, np.float64),
            terminated,
            truncated,
        )

    def close(self) -> None:
        """Close the environment."""
        if self._border is not None:
            self._border.close()
            self._border = None


class _Player:
    """One tree at the border.

    Attributes:
        visits: How often each leaf decided, [L].
    """

    def __init__(self, border: Border, arrays: ForestArrays, tree: int, watch: Watch) -> None:
        self._border, self._watch = border, watch
        self._root, self._walk = _compiled(arrays, tree)
        self._actions = arrays.action[arrays.leaf_start[tree] : arrays.leaf_start[tree + 1]].tolist()
        self.visits = [0] * len(self._actions)

    def decide(self, observation: list[float]) -> int:
        action: int = self._actions[self._walk(self._root, observation)]
        return action

    def episode(
        self, seed: int, seen: list[list[float]] | None = None, n_steps: int | None = None
    ) -> tuple[float, int]:
        """Play an episode, or its first `n_steps` steps; return its return and length; add to `seen`."""
        step, watch = self._border.step, self._watch
        root, walk, actions, visits, clock = self._root, self._walk, self._actions, self.visits, time.perf_counter
        observation = self._border.reset(seed)
        total, length, counted = 0.0, 0, 0
        ended = False
        try:
            while not ended:
                leaf = walk(root, observation)
                visits[leaf] += 1
                if seen is not None:
                    seen.append(observation)
                observation, reward, terminated, truncated = step(actions[leaf])
                total += reward
                length += 1
                ended = terminated or truncated or length == n_steps
                if clock() >= watch.due or length - counted >= watch.allowance:
                    n_new, counted = length - counted, length
                    watch.look(n_new)
        finally:
            watch.count(length - counted)
        return total, length


def _compiled(arrays: ForestArrays, tree: int) -> tuple[_Node, Callable[[_Node, list[float]], int]]:
    """Return a tree as nested tuples, and the function that walks them to a leaf."""
    first, end = int(arrays.split_start[tree]), int(arrays.split_start[tree + 1])
    splits, terms = slice(first, end), slice(int(arrays.term_start[first]), int(arrays.term_start[end]))
    is_axis_aligned = terms.stop - terms.start == end - first and bool((arrays.weight[terms] == 1).all())
    features: list[Any] = arrays.feature[terms].tolist()
    if not is_axis_aligned:
        weighted = list(zip(features, arrays.weight[terms].tolist(), strict=True))
        starts = (arrays.term_start[first : end + 1] - terms.start).tolist()
        features = [tuple(weighted[a:b]) for a, b in zip(starts[:-1], starts[1:], strict=True)]
    thresholds = arrays.threshold[splits].tolist()
    left, right = arrays.children_left[splits].tolist(), arrays.children_right[splits].tolist()
    nodes: list[_Node] = [0] * (end - first)
    # Depth first, children stand behind their parents.
    for m in range(end - first - 1, -1, -1):
        children = [nodes[child] if child >= 0 else ~child for child in (left[m], right[m])]
        nodes[m] = (features[m], thresholds[m], children[0], children[1])
    return nodes[0] if nodes else 0, _walk if is_axis_aligned else _walk_sums


def _walk(node: Any, observation: list[float]) -> int:
    # The tuple check is the quickest way to tell a split from a leaf; a list of arrays costs four look-ups more.
    while type(node) is tuple:
        feature, threshold, left, right = node
        node = left if observation[feature] < threshold else right
    leaf: int = node
    return leaf


def _walk_sums(node: Any, observation: list[float]) -> int:
    while type(node) is tuple:
        terms, threshold, left, right = node
        total = 0.0
        for feature, weight in terms:
            total += weight * observation[feature]
        node = left if total < threshold else right
    leaf: int = node
    return leaf
