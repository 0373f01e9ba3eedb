"""The kernel backend: fused kernels on threads, for the environments that have compiled dynamics."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from functools import cached_property, partial
from itertools import product
from math import ceil
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import (
    Accountable,
    Backend,
    Ledger,
    LimitReachedError,
    Outcomes,
    Trajectory,
    available_cores,
)
from ge_torchrl.environments.gymnasium_runner import LedgerWatch, Runner
from ge_torchrl.environments.kernel_choice import dynamics_of
from ge_torchrl.environments.kernel_probe import probing_trees
from ge_torchrl.environments.kernel_sampler import CHUNK_STEPS, KernelSampler, action_bounds, ranges
from ge_torchrl.environments.kernels.dynamics import DYNAMICS
from ge_torchrl.environments.kernels.recording import Recording, record_steps
from ge_torchrl.environments.kernels.rollouts import run_forest
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.environments.threads import Task, Threads, quick_switches
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

_Result = TypeVar("_Result")

_NO_VISITS = np.zeros(0, np.int64)
# More chunks than threads, so that a thread whose trees fall early finds other work.
_CHUNKS_PER_THREAD = 4
# A chunk makes this part of the steps that a limit allows, at most.
_CHUNK_PART = 0.05
# Training episodes begun at a time while a tree is observed.
_STARTS_PER_BLOCK = 32
# Drawing the first states of a million episodes takes a second: between so many the limit is looked at.
_EPISODES_PER_BLOCK = 50_000
_PROBE_EPISODES = 32


class KernelBackend(Accountable):
    """Runs trees in fused kernels; see `Backend`. Results do not depend on the number of threads.

    Args:
        spec: An environment that has a kernel.
        threads: Number of threads; 0 means one for each core that this process may use.
        ledger: Where steps are counted; None for a new one.

    Raises:
        EnvironmentFaultError: The environment has no kernel.
    """

    name = "kernel"
    workers = 0
    processes = 1
    sampling_processes = 0

    def __init__(self, spec: EnvironmentSpec, threads: int = 0, ledger: Ledger | None = None) -> None:
        super().__init__(ledger)
        dynamics = dynamics_of(spec)
        if dynamics is None:
            raise EnvironmentFaultError(
                f"env.route=kernel needs a kernel, which exist for {', '.join(DYNAMICS)} as they are registered, "
                f"without arguments or wrappers, and for env.dynamics; got {spec.id} "
                "(env.route=gymnasium runs every environment)"
            )
        self.spec = spec
        self._dynamics = dynamics
        self._bounds = action_bounds(spec)
        self._threads = Threads(threads or available_cores(), self.ledger)

    @cached_property
    def steps_per_second(self) -> float:
        """How fast small random trees run; see `Backend`."""
        forest = probing_trees(self.spec, self._dynamics)
        backend = KernelBackend(self.spec, self._threads.n)
        try:
            # The first call may wait for a compilation.
            backend.evaluate(forest.take([0]), np.arange(_PROBE_EPISODES), "warm-up")
            started = time.perf_counter()
            steps = backend.evaluate(forest, np.arange(_PROBE_EPISODES), "probe").env_steps
            return steps / (time.perf_counter() - started)
        finally:
            backend.close()

    @property
    def witness(self) -> None:
        """Nobody: a kernel keeps its bounds."""
        return

    @property
    def bounds(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Bounds [D], [D] of observations, which a kernel keeps."""
        return self.spec.low, self.spec.high

    def evaluate(
        self, forest: Forest, seeds: NDArray[np.int64], purpose: str, *, visits: bool = False
    ) -> Outcomes:
        """Run every tree on the episodes of `seeds`; see `Backend`."""
        self._check(forest)
        if len(seeds) <= _EPISODES_PER_BLOCK:
            return self._evaluate(forest, seeds, purpose, visits=visits)
        outcomes = Outcomes.empty(
            len(forest), len(seeds), int(forest.arrays.leaf_start[-1]) if visits else None
        )
        for first in range(0, len(seeds), _EPISODES_PER_BLOCK):
            block = slice(first, first + _EPISODES_PER_BLOCK)
            part = self._evaluate(forest, seeds[block], purpose, visits=visits)
            outcomes.returns[:, block], outcomes.lengths[:, block] = part.returns, part.lengths
            if outcomes.leaf_visits is not None and part.leaf_visits is not None:
                outcomes.leaf_visits[:] += part.leaf_visits
        return outcomes

    def _evaluate(self, forest: Forest, seeds: NDArray[np.int64], purpose: str, *, visits: bool) -> Outcomes:
        self.ledger.check()
        n_leaves = int(forest.arrays.leaf_start[-1])
        outcomes = Outcomes.empty(len(forest), len(seeds), n_leaves if visits else None)
        starts = self._dynamics.starts(np.ascontiguousarray(seeds, np.int64))

        adding, cut = threading.Lock(), threading.Event()

        def run(trees: tuple[int, int], episodes: tuple[int, int]) -> int:
            counts = np.zeros(n_leaves, np.int64) if visits else _NO_VISITS
            longest = self.spec.max_episode_steps
            if self._most_steps(trees, episodes) == longest:
                # A lone episode, which may be a large part of a small limit: no other one runs beside it then.
                longest = int(min(longest, self.ledger.steps_left + 1))
            n_steps = run_forest(
                forest.arrays, self._dynamics.index, longest, starts, self._bounds,
                *trees, *episodes, outcomes.returns, outcomes.lengths, counts,
            )  # fmt: skip
            if n_steps == longest < self.spec.max_episode_steps:
                cut.set()
            if outcomes.leaf_visits is not None:
                with adding:
                    outcomes.leaf_visits[:] += counts
            return n_steps

        tasks = (
            Task(partial(run, trees, episodes), self._most_steps(trees, episodes))
            for trees, episodes in self._chunks(len(forest), len(seeds))
        )
        with self.ledger.timing(purpose):
            self._threads.run(tasks, purpose, self._most_steps((0, len(forest)), (0, len(seeds))))
        if cut.is_set():
            raise LimitReachedError("max_env_steps")
        self._refuse_what_is_lost(forest, seeds, outcomes)
        return outcomes

    def _refuse_what_is_lost(self, forest: Forest, seeds: NDArray[np.int64], outcomes: Outcomes) -> None:
        """Tell where a user's own dynamics went wrong: there the return is no number."""
        lost = np.argwhere(~np.isfinite(outcomes.returns) & (outcomes.lengths > 0))
        if len(lost) == 0:
            return
        tree, episode = lost[0]
        with closing(Runner(self.spec)) as runner:
            # Gymnasium's environment raises at the very step.
            runner.record(forest.take([tree]), int(seeds[episode]), LedgerWatch(Ledger(), "record"))
        raise EnvironmentFaultError(
            f"{self.spec.id}: the return of episode seed {seeds[episode]} is no finite number"
        )

    def _most_steps(self, trees: tuple[int, int], episodes: tuple[int, int]) -> int:
        return (trees[1] - trees[0]) * (episodes[1] - episodes[0]) * self.spec.max_episode_steps

    def _chunks(self, n_trees: int, n_episodes: int) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
        """Return ranges of trees and of episodes that together are all.

        Where a limit of steps could be reached they do not depend on the number of threads.
        """
        most_steps, threads = self._steps_of_a_chunk(n_trees * n_episodes * self.spec.max_episode_steps)
        tree_parts = episode_parts = 1
        if threads > 1 and n_trees >= 2 * threads:
            tree_parts = threads * _CHUNKS_PER_THREAD
        elif threads > 1:
            episode_parts = threads
        while True:
            tree_parts, episode_parts = min(tree_parts, n_trees), min(episode_parts, n_episodes)
            largest = (0, ceil(n_trees / max(tree_parts, 1))), (0, ceil(n_episodes / max(episode_parts, 1)))
            if self._most_steps(*largest) <= most_steps or (tree_parts, episode_parts) == (
                n_trees,
                n_episodes,
            ):
                break
            if tree_parts < n_trees:
                tree_parts *= 2
            else:
                episode_parts *= 2
        return product(ranges(n_trees, tree_parts), ranges(n_episodes, episode_parts))

    def _steps_of_a_chunk(self, all_steps: int) -> tuple[float, int]:
        """Return how many steps a chunk may make, and among how many threads work may be divided."""
        limit = self.limit
        if limit is None or limit.max_env_steps is None or all_steps < self.ledger.steps_left:
            return CHUNK_STEPS, self._threads.n
        return min(CHUNK_STEPS, _CHUNK_PART * limit.max_env_steps), 1

    def sampler(self, rngs: Sequence[np.random.Generator]) -> KernelSampler:
        """Return streams of training episodes; see `Backend`."""
        return KernelSampler(self.spec, self._threads, self.ledger, rngs)

    def observe(
        self, trees: Sequence[DecisionTree], n_steps: int, rngs: Sequence[np.random.Generator], purpose: str
    ) -> NDArray[np.float32]:
        """Return what trees see; see `Backend`."""
        forest, n_values = Forest.stack(trees), self._bounds.shape[1]
        self._check(forest)
        if n_steps * len(trees) > self.ledger.steps_left:
            raise LimitReachedError("max_env_steps")
        observations = np.empty((len(trees), n_steps, self.spec.n_features), np.float32)

        def run(tree: int) -> int:
            recording, n_done = Recording.empty(n_steps, self.spec.n_features, n_values), 0
            while n_done < n_steps:
                seeds = episode_seeds("training", _STARTS_PER_BLOCK, rngs[tree])
                n_done = self._record(forest, tree, seeds, recording, n_done)
            observations[tree] = recording.observations[:-1]
            return n_steps

        tasks = (Task(partial(run, tree), n_steps) for tree in range(len(trees)))
        self._threads.run(tasks, purpose, n_steps * len(trees))
        return observations

    def _record(
        self, forest: Forest, tree: int, seeds: NDArray[np.int64], recording: Recording, first: int
    ) -> int:
        return record_steps(
            self._dynamics.index, self.spec.max_episode_steps, self._dynamics.starts(seeds), self._bounds,
            forest.arrays, tree, recording, first,
        )  # fmt: skip

    def record(self, tree: DecisionTree, seed: int) -> Trajectory:
        """Return one episode, step by step; see `Backend`."""
        self.ledger.check()
        forest, n_values = Forest.stack([tree]), self._bounds.shape[1]
        self._check(forest)
        recording = Recording.empty(self.spec.max_episode_steps, self.spec.n_features, n_values)
        n_steps = self._record(forest, 0, np.array([seed]), recording, 0)
        self.ledger.count("record", n_steps)
        return Trajectory(
            observations=recording.observations[: n_steps + 1].copy(),
            actions=(recording.values if n_values else recording.actions)[:n_steps].copy(),
            rewards=recording.rewards[:n_steps].copy(),
            terminated=bool(recording.terminated[n_steps - 1]),
            truncated=bool(recording.truncated[n_steps - 1]),
        )

    def _check(self, forest: Forest) -> None:
        """Refuse trees whose answers are no actions here: kernels would read beyond their arrays."""
        n_values = self._bounds.shape[1]
        if forest.arrays.leaf_start[-1] > 0 and forest.n_values != n_values:
            kinds = [f"{n} values a leaf" if n else "actions" for n in (n_values, forest.n_values)]
            raise ValueError(f"{self.spec.id} takes {kinds[0]}; these trees hold {kinds[1]}")

    def run_jobs(self, jobs: Sequence[Callable[[Backend], _Result]]) -> list[_Result]:
        """Run jobs on the threads, each with a backend of one thread; see `Backend`.

        Under a limit of steps jobs run one after another, so that it ends the run at the same job on any machine.
        """
        if self._threads.n == 1 or (self.limit is not None and self.limit.max_env_steps is not None):
            return [job(self) for job in jobs]
        single, results = KernelBackend(self.spec, 1, self.ledger), dict[int, _Result]()

        def run(number: int) -> int:
            results[number] = jobs[number](single)
            return 0

        with quick_switches():
            self._threads.run([Task(partial(run, number)) for number in range(len(jobs))], "")
        return [results[number] for number in range(len(jobs))]

    def close(self) -> None:
        """Release the threads."""
        self._threads.close()
