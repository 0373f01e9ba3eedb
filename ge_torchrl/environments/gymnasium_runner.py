"""One process plays episodes of a Gymnasium environment, one after another, without a NumPy call of our own a step."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import Ledger, Trajectory
from ge_torchrl.environments.border import Action, Border
from ge_torchrl.environments.plain_trees import leaves, nested, values_of, walk_sums
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.environments.witness import Witness
from ge_torchrl.trees.forest import Forest, ForestArrays

# A limit or a sign of life is looked after this often [s].
_LOOK_SECONDS = 0.25
# Of each step: what was observed, what was done, what it paid.
_Diary: TypeAlias = list[tuple[list[float], Action, float]]
# Reading the clock costs a hundredth of a CartPole step: it is read after so long [s].
_STRIDE_SECONDS = 0.01


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
        self.allowance -= n_steps

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
        self._pace = _Pace()
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
        played = Played(
            np.zeros(len(jobs)), np.zeros(len(jobs), np.int64), np.zeros(int(arrays.leaf_start[-1]), np.int64)
        )
        edges = [*np.flatnonzero(np.diff(jobs.tree, prepend=-1)).tolist(), len(jobs)]
        for first, end in itertools.pairwise(edges):
            tree = int(jobs.tree[first])
            player = _Player(self.border, arrays, tree, watch, self._pace)
            for j in range(first, end):
                played.returns[j], played.lengths[j] = player.episode(int(jobs.seed[j]))
            played.leaf_visits[arrays.leaf_start[tree] : arrays.leaf_start[tree + 1]] += player.visits
        return played

    def observe(
        self, forest: Forest, tree: int, seeds: Sequence[int], n_steps: int, watch: Watch
    ) -> NDArray[np.float32]:
        """Return what a tree sees in its first `n_steps` steps, or fewer where the episodes of `seeds` have fewer."""
        player = _Player(self.border, forest.arrays, tree, watch, self._pace)
        diary: _Diary = []
        for seed in seeds:
            if len(diary) == n_steps:
                break
            player.episode(seed, diary, n_steps - len(diary))
        seen = [observation for observation, _, _ in diary]
        return np.array(seen, np.float32).reshape(len(seen), self.spec.n_features)

    def record(self, forest: Forest, seed: int, watch: Watch) -> Trajectory:
        """Return an episode of the forest's only tree, step by step."""
        player = _Player(self.border, forest.arrays, 0, watch, self._pace)
        diary: _Diary = []
        player.episode(seed, diary)
        observations, actions, rewards = zip(*diary, strict=True)
        if self.spec.is_continuous:
            done = np.clip(np.array(actions), *np.array(self.border.action_bounds).T).astype(np.float32)
        else:
            done = np.array(actions, np.int64)
        return Trajectory(
            np.array([*observations, self.border.array], np.float32),
            done,
            np.array(rewards, np.float64),
            terminated=player.terminated,
            truncated=player.truncated,
        )

    def close(self) -> None:
        """Close the environment."""
        if self._border is not None:
            self._border.close()
            self._border = None


class _Pace:
    """Chooses how many steps go between two looks at the clock, a few milliseconds' worth."""

    def __init__(self) -> None:
        self.stride = 1
        self._last = time.perf_counter()

    def now(self, n_steps: int) -> float:
        """Return the time, `n_steps` after the last look."""
        now = time.perf_counter()
        elapsed, self._last = now - self._last, now
        if elapsed > _STRIDE_SECONDS:
            self.stride = max(1, n_steps // 2)
        elif n_steps >= self.stride and elapsed < _STRIDE_SECONDS / 2:
            self.stride *= 2
        return now


class _Player:
    """One tree at the border.

    Attributes:
        visits: How often each leaf decided, [L].
        terminated: Whether the task ended the last episode.
        truncated: Whether its limit did.
    """

    def __init__(self, border: Border, arrays: ForestArrays, tree: int, watch: Watch, pace: _Pace) -> None:
        self._border, self._watch, self._pace = border, watch, pace
        self._root, self._is_axis_aligned = nested(arrays, tree)
        self._answers, self._laws = leaves(arrays, tree)
        self.visits = [0] * len(self._answers)
        self.terminated = self.truncated = False

    def episode(
        self, seed: int, diary: _Diary | None = None, n_steps: int | None = None
    ) -> tuple[float, int]:
        """Play an episode, or its first `n_steps` steps; return its return and length; write them down."""
        step, watch, pace = self._border.step, self._watch, self._pace
        root, is_axis_aligned, visits = self._root, self._is_axis_aligned, self.visits
        answers, laws = self._answers, self._laws
        observation = self._border.reset(seed)
        total, length, counted, read = 0.0, 0, 0, 0
        next_look = min(pace.stride, watch.allowance)
        ended = terminated = truncated = False
        try:
            while not ended:
                node = root if is_axis_aligned else walk_sums(root, observation)
                # The quickest way in Python to tell a split from a leaf, and written here: a call costs as much again.
                while type(node) is tuple:
                    feature, threshold, left, right = node
                    node = left if observation[feature] < threshold else right
                visits[node] += 1
                before = observation
                action = answers[node] if laws is None else values_of(laws[node], observation)
                observation, reward, terminated, truncated = step(action)
                if diary is not None:
                    diary.append((before, action, reward))
                total += reward
                length += 1
                ended = terminated or truncated or length == n_steps
                if length >= next_look or ended:
                    now, read = pace.now(length - read), length
                    if now >= watch.due or length - counted >= watch.allowance:
                        n_new, counted = length - counted, length
                        watch.look(n_new)
                    next_look = min(length + pace.stride, counted + watch.allowance)
        finally:
            watch.count(length - counted)
        self.terminated, self.truncated = bool(terminated), bool(truncated)
        return total, length
