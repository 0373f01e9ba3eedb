"""The Gymnasium backend: any environment that a tree can act in, stepped in worker processes."""

from __future__ import annotations

import itertools
import logging
import time
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import (
    Accountable,
    Backend,
    Ledger,
    Outcomes,
    Sampler,
    Trajectory,
    available_cores,
)
from ge_torchrl.environments.border import random_action
from ge_torchrl.environments.gymnasium_runner import Jobs, LedgerWatch, Played, Runner, Watch
from ge_torchrl.environments.gymnasium_workers import Workers
from ge_torchrl.environments.sending import portable
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.environments.witness import Witness
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

_Result = TypeVar("_Result")
_logger = logging.getLogger(__name__)

# Random steps that look for untrue bounds, always as many, so that what is found is the same in every run.
_PROBED_STEPS = 200
# Of a slow environment these are all: of one whose first so many steps take longer [s].
_FIRST_STEPS = 20
_FIRST_SECONDS = 0.5
# Of the slowest these end after so long [s].
_LONGEST_SECONDS = 5.0
# Then so many are timed, or as many as half a second takes.
_TIMED_STEPS = 2000
_TIMED_SECONDS = 0.5
# Starting worker processes takes so long, and sending them work [s].
_START_SECONDS = 3.0
_SEND_SECONDS = 0.05
# Small chunks even out episodes of unlike length.
_CHUNKS_PER_WORKER = 8
# As many episodes are drawn at once for what trees see.
_OBSERVED_EPISODES = 32


class GymnasiumBackend(Accountable):
    """Steps Gymnasium itself, one episode at a time in each process.

    The results do not depend on the number of processes.

    Args:
        spec: The environment.
        workers: Number of processes; 0 means one for each core where that pays, 1 none but this one.
        ledger: Another's, where the steps are counted together; None for a new one.

    Attributes:
        workers: As given, for others who step the environment in processes of their own.
        processes: Processes that ran trees so far; 1 is this one alone.
        sampling_processes: Processes that stepped it for TorchRL, as those tell who started them; 0 where none did.

    Raises:
        EnvironmentFaultError: The environment breaks its word in its first few hundred steps, or cannot be sent to the
            processes that were asked for.
    """

    name = "gymnasium"

    def __init__(self, spec: EnvironmentSpec, workers: int = 0, ledger: Ledger | None = None) -> None:
        super().__init__(ledger)
        self.spec = spec
        self.workers = workers
        self.processes = 1
        self.sampling_processes = 0
        self._n_workers = workers or available_cores()
        self._pool: Workers | None = None
        if workers > 1:
            # Told at once, and not when the first work is sent.
            portable(spec)
        self._runner = Runner(spec)
        one_process, self._likely_length = self._probe()
        self.steps_per_second = one_process * self._n_workers

    @property
    def witness(self) -> Witness:
        """What was seen of the environment that it had not said of itself."""
        return self._runner.witness

    @property
    def bounds(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Bounds [D], [D] that every observation so far kept; trees may be simplified by them.

        They are those that the environment declares, infinite for each feature that was seen outside.
        """
        return self._runner.witness.bounds

    def _probe(self) -> tuple[float, float]:
        """Act at random; return the steps a second of one process, and the mean length of an episode."""
        border, rng, seeds = self._runner.border, np.random.default_rng(0), itertools.count()
        ended, episodes, started = True, 0, time.perf_counter()
        n_probed, step = _PROBED_STEPS, 0
        while step < n_probed + _TIMED_STEPS:
            if ended:
                border.reset(next(seeds))
                episodes += 1
            _, _, terminated, truncated = border.step(random_action(self.spec, rng))
            ended, step = terminated or truncated, step + 1
            seconds = time.perf_counter() - started
            if step > n_probed and seconds > _TIMED_SECONDS:
                break
            if step < _FIRST_STEPS and step < n_probed and seconds > _LONGEST_SECONDS:
                n_probed = step
            if step == _FIRST_STEPS and seconds > _FIRST_SECONDS:
                n_probed = min(n_probed, step)
            if step == n_probed:
                # How many steps are timed depends on the clock: what the rest of a run knows must not.
                border.watched_by(Witness(self.spec))
                started = time.perf_counter()
        steps_per_second = (step - n_probed) / (time.perf_counter() - started)
        border.watched_by(self._runner.witness)
        self._runner.witness.report()
        return steps_per_second, step / episodes

    def evaluate(
        self, forest: Forest, seeds: NDArray[np.int64], purpose: str, *, visits: bool = False
    ) -> Outcomes:
        """Run every tree on the episodes of `seeds`; see `Backend`."""
        n_leaves = int(forest.arrays.leaf_start[-1])
        outcomes = Outcomes.empty(len(forest), len(seeds), n_leaves if visits else None)
        trees = np.flatnonzero(forest.valid)
        jobs = Jobs(np.repeat(trees, len(seeds)), np.tile(seeds, len(trees)))
        watch = LedgerWatch(self.ledger, purpose)
        workers = self._workers_for(len(jobs), len(jobs) * self._likely_length)
        with self.ledger.timing(purpose):
            if workers is None:
                played = self._alone(lambda: self._runner.play(forest, jobs, watch))
            else:
                played = self._play_together(workers, forest, jobs, watch)
        shape = (len(trees), len(seeds))
        outcomes.returns[trees] = played.returns.reshape(shape)
        outcomes.lengths[trees] = played.lengths.reshape(shape)
        if outcomes.leaf_visits is not None:
            outcomes.leaf_visits[:] = played.leaf_visits
        if len(jobs) > 0:
            self._likely_length = float(played.lengths.mean())
        return outcomes

    def _play_together(self, workers: Workers, forest: Forest, jobs: Jobs, watch: Watch) -> Played:
        n_chunks = min(workers.n_workers * _CHUNKS_PER_WORKER, len(jobs))
        edges = np.linspace(0, len(jobs), n_chunks + 1).astype(int).tolist()
        chunks, arguments = [], []
        for first, end in itertools.pairwise(edges):
            trees, tree = np.unique(jobs.tree[first:end], return_inverse=True)
            chunks.append(trees)
            arguments.append((forest.take(trees), Jobs(tree, jobs.seed[first:end])))
        parts = self._together(workers, _play, arguments, watch)
        leaf_visits = np.zeros(int(forest.arrays.leaf_start[-1]), np.int64)
        for trees, part in zip(chunks, parts, strict=True):
            start = forest.arrays.leaf_start
            leaves = np.concatenate([np.arange(start[p], start[p + 1]) for p in trees])
            leaf_visits[leaves] += part.leaf_visits
        return Played(
            np.concatenate([part.returns for part in parts]),
            np.concatenate([part.lengths for part in parts]),
            leaf_visits,
        )

    def observe(
        self, trees: Sequence[DecisionTree], n_steps: int, rngs: Sequence[np.random.Generator], purpose: str
    ) -> NDArray[np.float32]:
        """Return what trees see; see `Backend`."""
        forest = Forest.stack(trees)
        seen = np.empty((len(trees), n_steps, self.spec.n_features), np.float32)
        filled = np.zeros(len(trees), np.int64)
        watch = LedgerWatch(self.ledger, purpose)
        while (missing := np.flatnonzero(filled < n_steps)).size > 0:
            arguments = [
                (
                    forest.take([r]),
                    0,
                    episode_seeds("training", _OBSERVED_EPISODES, rngs[r]).tolist(),
                    int(n_steps - filled[r]),
                )
                for r in missing.tolist()
            ]
            workers = self._workers_for(len(missing), float((n_steps - filled[missing]).sum()))
            if workers is None:
                parts = self._alone(lambda: [self._runner.observe(*each, watch) for each in arguments])  # noqa: B023
            else:
                parts = self._together(workers, _observe, arguments, watch)
            for r, part in zip(missing, parts, strict=True):
                seen[r, filled[r] : filled[r] + len(part)] = part
                filled[r] += len(part)
        return seen

    def record(self, tree: DecisionTree, seed: int) -> Trajectory:
        """Return one episode, step by step; see `Backend`."""
        watch = LedgerWatch(self.ledger, "record")
        return self._alone(lambda: self._runner.record(Forest.stack([tree]), int(seed), watch))

    def sampler(self, rngs: Sequence[np.random.Generator]) -> Sampler | None:  # noqa: ARG002
        """Return None: TorchRL samples Gymnasium; see `Backend`."""
        return None

    def run_jobs(self, jobs: Sequence[Callable[[Backend], _Result]]) -> list[_Result]:
        """Run jobs one after another, each with all worker processes; see `Backend`."""
        return [job(self) for job in jobs]

    def close(self) -> None:
        """Release processes and environments."""
        if self._pool is not None:
            self._pool.close()
            self._pool = None
        self._runner.close()

    def _alone(self, play: Callable[[], _Result]) -> _Result:
        try:
            return play()
        finally:
            self._runner.witness.report()

    def _together(
        self,
        workers: Workers,
        task: Callable[..., tuple[_Result, dict[int, float], bool]],
        arguments: Sequence[tuple[object, ...]],
        watch: Watch,
    ) -> list[_Result]:
        parts = workers.map(task, arguments, watch)
        witness = self._runner.witness
        for _, outside, is_endless in parts:
            witness.hear(outside, is_endless=is_endless)
        witness.report()
        return [result for result, _, _ in parts]

    def _workers_for(self, n_jobs: int, likely_steps: float) -> Workers | None:
        """Return the worker processes where they pay, started if need be."""
        if self._pool is not None and not self._pool.is_usable:
            self._pool.close()
            self._pool = None
        if self._n_workers == 1 or n_jobs < 2 * self._n_workers:
            return None
        overhead = _SEND_SECONDS if self._pool is not None else _START_SECONDS
        if self.workers == 0 and likely_steps / self.steps_per_second * self._n_workers < 2 * overhead:
            return None
        if self._pool is None:
            try:
                self._pool = Workers(self.spec, self._n_workers)
            except EnvironmentFaultError as error:
                if self.workers > 0:
                    raise
                _logger.warning("%s; running in this process alone.", error)
                self._n_workers = 1
                return None
        self.processes = self._n_workers
        return self._pool


def _play(runner: Runner, watch: Watch, forest: Forest, jobs: Jobs) -> tuple[Played, dict[int, float], bool]:
    played = runner.play(forest, jobs, watch)
    return played, runner.witness.outside, runner.witness.is_endless


def _observe(
    runner: Runner, watch: Watch, forest: Forest, tree: int, seeds: list[int], n_steps: int
) -> tuple[NDArray[np.float32], dict[int, float], bool]:
    seen = runner.observe(forest, tree, seeds, n_steps, watch)
    return seen, runner.witness.outside, runner.witness.is_endless
