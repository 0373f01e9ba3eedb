"""The compiled route: fused kernels on threads, for the environments that have compiled dynamics."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import lru_cache
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.dynamics import DYNAMICS, Starts
from ge_torchrl.environments.rollouts import run_forest
from ge_torchrl.environments.route import Outcomes, Route
from ge_torchrl.environments.soft_rollouts import SoftSampler, SoftTree
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.simplify import simplify_forest

_Result = TypeVar("_Result")

_NO_VISITS = np.zeros(0, np.int64)
# More chunks than threads, so that a thread whose trees fall early finds other work.
_CHUNKS_PER_THREAD = 4


class CompiledRoute:
    """Runs trees in fused kernels.

    Args:
        spec: An environment of `DYNAMICS`.
        threads: Number of threads; 0 means one for each core. Results do not depend on it.

    Raises:
        EnvironmentFaultError: The environment has no compiled dynamics.
    """

    name = "compiled"

    def __init__(self, spec: EnvironmentSpec, threads: int = 0) -> None:
        if spec.id not in DYNAMICS:
            raise EnvironmentFaultError(
                f"env.route=compiled needs compiled dynamics, which exist for {', '.join(DYNAMICS)}; "
                f"got {spec.id} (env.route=gymnasium runs every environment)"
            )
        self.spec = spec
        self._dynamics = DYNAMICS[spec.id]
        self._threads = threads or os.cpu_count() or 1
        self._pool = ThreadPoolExecutor(self._threads) if self._threads > 1 else None
        # Fitness asks for the same few seeds again and again.
        self._starts = lru_cache(maxsize=8)(self._make_starts)

    def _make_starts(self, seeds: bytes) -> Starts:
        return self._dynamics.starts(np.frombuffer(seeds, np.int64))

    def evaluate(self, forest: Forest, seeds: NDArray[np.int64]) -> Outcomes:
        """Run every tree on the episodes of `seeds`; see `Route`."""
        # Splits that no observation can reach are most of a young tree; without them trees are small and quick.
        simple = simplify_forest(forest, self.spec.low, self.spec.high)
        starts = self._starts(np.ascontiguousarray(seeds, np.int64).tobytes())
        if len(forest) >= 2 * self._threads:
            return self._over_trees(simple, starts)
        return self._over_episodes(simple, starts)

    def _over_trees(self, forest: Forest, starts: Starts) -> Outcomes:
        outcomes = Outcomes.empty(len(forest), len(starts))
        n_chunks = min(len(forest), self._threads * _CHUNKS_PER_THREAD if self._threads > 1 else 1)
        edges = np.linspace(0, len(forest), n_chunks + 1).astype(int)

        def run(chunk: int) -> None:
            self._run(forest, starts, int(edges[chunk]), int(edges[chunk + 1]), outcomes)

        self._each(run, n_chunks)
        return outcomes

    def _over_episodes(self, forest: Forest, starts: Starts) -> Outcomes:
        chunks = [part for part in np.array_split(starts, self._threads) if len(part) > 0]
        parts = [Outcomes.empty(len(forest), len(chunk)) for chunk in chunks]

        def run(chunk: int) -> None:
            self._run(forest, chunks[chunk], 0, len(forest), parts[chunk])

        self._each(run, len(chunks))
        return Outcomes(
            returns=np.concatenate([part.returns for part in parts], axis=1),
            lengths=np.concatenate([part.lengths for part in parts], axis=1),
        )

    def _each(self, run: Callable[[int], None], n_chunks: int) -> None:
        if self._pool is None:
            for chunk in range(n_chunks):
                run(chunk)
        else:
            list(self._pool.map(run, range(n_chunks)))

    def _run(
        self,
        forest: Forest,
        starts: Starts,
        first: int,
        last: int,
        outcomes: Outcomes,
        visits: NDArray[np.int64] = _NO_VISITS,
    ) -> None:
        run_forest(
            self._dynamics.index,
            starts,
            self.spec.max_episode_steps,
            forest.arrays,
            first,
            last,
            outcomes.returns,
            outcomes.lengths,
            visits,
        )

    def count_visits(self, tree: DecisionTree, seeds: NDArray[np.int64]) -> NDArray[np.int64]:
        """Count how often each node is passed; see `Route`."""
        visits = np.zeros(tree.n_nodes, np.int64)
        starts = self._starts(np.ascontiguousarray(seeds, np.int64).tobytes())
        self._run(Forest.stack([tree]), starts, 0, 1, Outcomes.empty(1, len(starts)), visits)
        return visits

    def observe(self, tree: DecisionTree, n_steps: int, rng: np.random.Generator) -> NDArray[np.float32]:
        """Return what a tree sees; see `Route`."""
        probabilities = np.zeros((tree.n_nodes, self.spec.n_actions))
        leaves = np.flatnonzero(tree.is_leaf)
        probabilities[leaves, tree.action[leaves]] = 1.0
        # So steep a decision is the hard one; exactly at the threshold the weight of the left branch is no number, no
        # draw is below it, and the observation goes right, as in the hard tree.
        steep = np.full(tree.n_nodes, np.inf)
        soft = SoftTree(
            tree.feature, tree.threshold, tree.children_left, tree.children_right, probabilities, steep
        )
        return SoftSampler(self.spec, rng).sample(soft, n_steps).observations

    def run_jobs(self, jobs: Sequence[Callable[[Route], _Result]]) -> list[_Result]:
        """Run jobs on the threads, each with a route of one thread; see `Route`."""
        if self._pool is None:
            return [job(self) for job in jobs]
        single = CompiledRoute(self.spec, threads=1)
        with _quick_switches():
            return list(self._pool.map(lambda job: job(single), jobs))

    def close(self) -> None:
        """Release the threads."""
        if self._pool is not None:
            self._pool.shutdown()


@contextmanager
def _quick_switches() -> Iterator[None]:
    # Jobs go back and forth between Python and kernels of a millisecond, which run without the interpreter's lock;
    # at Python's own 5 ms a thread would mostly wait for it.
    interval = sys.getswitchinterval()
    sys.setswitchinterval(5e-4)
    try:
        yield
    finally:
        sys.setswitchinterval(interval)
