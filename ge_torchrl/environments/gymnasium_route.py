"""The Gymnasium route: any environment with a flat Box observation and Discrete actions, in worker processes."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from ge_torchrl.environments.route import Outcomes, Route
from ge_torchrl.environments.spec import EnvironmentSpec, make_gymnasium
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest

_Result = TypeVar("_Result")

# Environments that one process steps side by side; one batched decision serves them all.
_ENVIRONMENTS_PER_PROCESS = 16
# Starting worker processes takes seconds: fewer steps than this are run in the calling process.
_STEPS_WORTH_WORKERS = 200_000
# What to expect of an episode whose environment sets no limit.
_LIKELY_STEPS = 1000


@dataclass(frozen=True, eq=False)
class _Jobs:
    """Episodes to run: `tree[j]` of the forest on the episode of `seed[j]`, both [J]."""

    tree: NDArray[np.int64]
    seed: NDArray[np.int64]


class GymnasiumRoute:
    """Steps Gymnasium itself, many environments at a time.

    Worker processes are started only when an evaluation could be long. They import the main module anew, as
    Python's `spawn` does: a script that uses this class needs the usual `if __name__ == "__main__":`.

    Args:
        spec: The environment.
        workers: Number of processes; 0 means one for each core where that pays, 1 none but this one.
    """

    name = "gymnasium"

    def __init__(self, spec: EnvironmentSpec, workers: int = 0) -> None:
        self.spec = spec
        self._workers = workers
        self._pool: ProcessPoolExecutor | None = None
        self._runner = _Runner(spec)

    def evaluate(self, forest: Forest, seeds: NDArray[np.int64]) -> Outcomes:
        """Run every tree on the episodes of `seeds`; see `Route`."""
        outcomes = Outcomes.empty(len(forest), len(seeds))
        trees = np.flatnonzero(forest.sizes > 0)
        jobs = _Jobs(tree=np.repeat(trees, len(seeds)), seed=np.tile(seeds, len(trees)))
        returns, lengths = self._run(forest, jobs)
        outcomes.returns[trees] = returns.reshape(len(trees), len(seeds))
        outcomes.lengths[trees] = lengths.reshape(len(trees), len(seeds))
        return outcomes

    def _run(self, forest: Forest, jobs: _Jobs) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        n_workers = self._workers or os.cpu_count() or 1
        likely_steps = len(jobs.seed) * (
            self.spec.max_episode_steps if self.spec.has_limit else _LIKELY_STEPS
        )
        long = self._workers > 1 or likely_steps >= _STEPS_WORTH_WORKERS
        if n_workers == 1 or not long or len(jobs.seed) < 2 * n_workers:
            return self._runner.run(forest, jobs)
        if self._pool is None:
            self._pool = ProcessPoolExecutor(
                n_workers,
                multiprocessing.get_context("spawn"),
                initializer=_start_worker,
                initargs=(self.spec, gym.spec(self.spec.id)),
            )
        # A few chunks a worker even out episodes of unlike length.
        edges = np.linspace(0, len(jobs.seed), min(4 * n_workers, len(jobs.seed)) + 1).astype(int)
        chunks = [_Jobs(jobs.tree[a:b], jobs.seed[a:b]) for a, b in itertools.pairwise(edges)]
        try:
            parts = list(self._pool.map(_run_in_worker, [forest] * len(chunks), chunks))
        except BaseException:
            # After a fault or Ctrl-C nobody waits for the other chunks; a later call starts new workers.
            self._pool.shutdown(wait=False, cancel_futures=True)
            self._pool = None
            raise
        return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])

    def count_visits(self, tree: DecisionTree, seeds: NDArray[np.int64]) -> NDArray[np.int64]:
        """Count how often each node is passed; see `Route`."""
        leaf_visits = np.zeros(tree.n_nodes, np.int64)
        jobs = _Jobs(tree=np.zeros(len(seeds), np.int64), seed=seeds)
        self._runner.run(Forest.stack([tree]), jobs, observer=_LeafCounter(tree, leaf_visits))
        return _visits_from_leaves(tree, leaf_visits)

    def observe(self, tree: DecisionTree, n_steps: int, rng: np.random.Generator) -> NDArray[np.float32]:
        """Return what a tree sees; see `Route`."""
        recorder = _Recorder(n_steps)
        while recorder.missing > 0:
            jobs = _Jobs(tree=np.zeros(1, np.int64), seed=episode_seeds("training", 1, rng))
            self._runner.run(Forest.stack([tree]), jobs, observer=recorder)
        return np.concatenate(recorder.observations)[:n_steps]

    def run_jobs(self, jobs: Sequence[Callable[[Route], _Result]]) -> list[_Result]:
        """Run jobs one after another, each with all worker processes; see `Route`."""
        return [job(self) for job in jobs]

    def close(self) -> None:
        """Release processes and environments."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
        self._runner.close()


class _Recorder:
    def __init__(self, n_steps: int) -> None:
        self.observations: list[NDArray[np.float32]] = []
        self.missing = n_steps

    def __call__(self, observations: NDArray[np.float32]) -> None:
        self.observations.append(observations.copy())
        self.missing -= len(observations)


@dataclass(frozen=True, eq=False)
class _LeafCounter:
    tree: DecisionTree
    visits: NDArray[np.int64]

    def __call__(self, observations: NDArray[np.float32]) -> None:
        self.visits[:] += np.bincount(self.tree.leaf_of(observations), minlength=self.tree.n_nodes)


def _visits_from_leaves(tree: DecisionTree, leaf_visits: NDArray[np.int64]) -> NDArray[np.int64]:
    """Add the visits of leaves up to their ancestors."""
    visits = leaf_visits.copy()
    order, stack = [], [0]
    while stack:
        node = stack.pop()
        order.append(node)
        if tree.children_left[node] != tree.NO_CHILD:
            stack += [int(tree.children_left[node]), int(tree.children_right[node])]
    for node in reversed(order):
        if tree.children_left[node] != tree.NO_CHILD:
            visits[node] = visits[tree.children_left[node]] + visits[tree.children_right[node]]
    return visits


class _Runner:
    """Steps up to `_ENVIRONMENTS_PER_PROCESS` environments side by side in this process."""

    def __init__(self, spec: EnvironmentSpec) -> None:
        self._spec = spec
        self._environments: list[gym.Env[NDArray[np.float32], int]] = []

    def run(
        self, forest: Forest, jobs: _Jobs, observer: Callable[[NDArray[np.float32]], None] | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return the returns and lengths [J] of all jobs."""
        n_jobs = len(jobs.seed)
        returns, lengths = np.zeros(n_jobs), np.zeros(n_jobs, np.int64)
        n = min(_ENVIRONMENTS_PER_PROCESS, n_jobs)
        while len(self._environments) < n:
            limit = self._spec.max_episode_steps if self._spec.has_limit else None
            self._environments.append(make_gymnasium(self._spec.id, limit))
        job = np.arange(n)
        observations = np.zeros((n, self._spec.n_features), np.float32)
        for lane in range(n):
            observations[lane] = self._reset(lane, int(jobs.seed[lane]))
        next_job = n
        while n > 0:
            if observer is not None:
                observer(observations)
            actions = forest.decide(jobs.tree[job], observations)
            for lane in range(n - 1, -1, -1):
                j = job[lane]
                observation, reward, ended = self._step(
                    lane, int(jobs.seed[j]), int(lengths[j]), int(actions[lane])
                )
                observations[lane] = observation
                returns[j] += reward
                lengths[j] += 1
                if not ended:
                    continue
                if next_job < n_jobs:
                    job[lane] = next_job
                    observations[lane] = self._reset(lane, int(jobs.seed[next_job]))
                    next_job += 1
                else:
                    # The last running lane moves into the free place, its environment with it.
                    n -= 1
                    environments = self._environments
                    environments[lane], environments[n] = environments[n], environments[lane]
                    job[lane], observations[lane] = job[n], observations[n]
            job, observations = job[:n], observations[:n]
        return returns, lengths

    def _reset(self, lane: int, seed: int) -> NDArray[np.float32]:
        try:
            observation, _ = self._environments[lane].reset(seed=seed)
        except Exception as error:
            raise self._fault(f"raised {error!r} in reset", seed, 0, None) from error
        return self._checked(observation, seed, 0, None)

    def _step(self, lane: int, seed: int, step: int, action: int) -> tuple[NDArray[np.float32], float, bool]:
        try:
            observation, reward, terminated, truncated, _ = self._environments[lane].step(
                action + self._spec.first_action
            )
        except Exception as error:
            raise self._fault(f"raised {error!r}", seed, step, action) from error
        if np.isnan(float(reward)):
            raise self._fault("returned a reward that is not a number", seed, step, action)
        if not self._spec.has_limit and step + 1 >= self._spec.max_episode_steps and not terminated:
            raise self._fault(
                f"did not end an episode within {self._spec.max_episode_steps} steps (set env.max_episode_steps)",
                seed, step, action,
            )  # fmt: skip
        return (
            self._checked(observation, seed, step, action),
            float(reward),
            bool(terminated or truncated),
        )

    def _checked(
        self, observation: NDArray[np.float32], seed: int, step: int, action: int | None
    ) -> NDArray[np.float32]:
        if np.isnan(observation).any():
            raise self._fault(f"returned an observation with NaN, {observation}", seed, step, action)
        return observation

    def _fault(self, what: str, seed: int, step: int, action: int | None) -> EnvironmentFaultError:
        where = f"episode seed {seed}, step {step}"
        if action is not None:
            where += f", action {action} ({self._spec.labels.actions[action]})"
        return EnvironmentFaultError(f"{self._spec.id} {what}; {where}")

    def close(self) -> None:
        for environment in self._environments:
            environment.close()
        self._environments.clear()


# The one runner of a worker process; set when the process starts.
_worker: list[_Runner] = []


def _start_worker(spec: EnvironmentSpec, registered: EnvSpec) -> None:
    # Ctrl-C is for the calling process, which ends its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # A new process does not know what the calling program registered by itself.
    gym.registry.setdefault(registered.id, registered)
    _worker.append(_Runner(spec))


def _run_in_worker(forest: Forest, jobs: _Jobs) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    return _worker[0].run(forest, jobs)
