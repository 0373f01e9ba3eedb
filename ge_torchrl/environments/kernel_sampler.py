"""Soft trees sampled in fused kernels on threads."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from math import ceil

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import Ledger, Samples, SoftForest
from ge_torchrl.environments.kernel_choice import dynamics_of
from ge_torchrl.environments.kernels.soft_rollouts import SoftStreams, check_soft_forest
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.environments.threads import Task, Threads
from ge_torchrl.errors import EnvironmentFaultError

# A chunk takes a tenth of a second at most.
CHUNK_STEPS = 1_000_000


class KernelSampler:
    """One endless stream of episodes for each of `R` soft trees, side by side on threads; see `Sampler`.

    Args:
        spec: An environment that has a kernel.
        threads: Where streams run.
        ledger: Where steps are counted.
        rngs: [R] each stream's own source of randomness.
    """

    def __init__(
        self,
        spec: EnvironmentSpec,
        threads: Threads,
        ledger: Ledger,
        rngs: Sequence[np.random.Generator],
    ) -> None:
        self._spec = spec
        self._threads = threads
        self._ledger = ledger
        bounds, dynamics = action_bounds(spec), dynamics_of(spec)
        if dynamics is None:
            raise ValueError(f"{spec.id} has no kernel")
        # As many groups for each thread, where that makes none of them too thin to be quick.
        n_groups = ceil(len(rngs) / (SoftStreams.WIDTH * threads.n)) * threads.n
        self._ranges = ranges(len(rngs), min(n_groups, len(rngs)))
        self._groups = [
            SoftStreams(dynamics.index, dynamics.starts, spec.max_episode_steps, bounds, rngs[slice(*trees)])
            for trees in self._ranges
        ]

    def sample(self, soft: SoftForest, n_steps: int, purpose: str) -> Samples:
        """Take the next `n_steps` steps of each stream; see `Sampler`."""
        n_trees = self._ranges[-1][1]
        check_soft_forest(soft, n_trees, self._spec)
        n_values = self._spec.n_actions if self._spec.is_continuous else 0
        samples = Samples.empty(n_trees, n_steps, self._spec.n_features, n_values)
        for first, last in ranges(n_steps, ceil(n_trees * n_steps / CHUNK_STEPS)):
            tasks = [
                Task(partial(group.fill, soft, trees[0], samples, first, last))
                for group, trees in zip(self._groups, self._ranges, strict=True)
            ]
            n_steps = n_trees * (last - first)
            self._threads.run(tasks, purpose, n_steps)
            # All at once: how streams are grouped must not show where a limit ends the run.
            self._ledger.count(purpose, n_steps)
        self._refuse_what_is_lost(samples)
        return samples

    def _refuse_what_is_lost(self, samples: Samples) -> None:
        """Tell where a user's own dynamics went wrong: there the reward is no number."""
        lost = np.argwhere(~np.isfinite(samples.rewards))
        if len(lost) == 0:
            return
        place, names = tuple(lost[0]), self._spec.names
        seen = ", ".join(
            f"{name} = {value:g}"
            for name, value in zip(names.features, samples.observations[place], strict=True)
        )
        action = samples.actions[place]
        told = names.actions[action] if action.ndim == 0 else action
        raise EnvironmentFaultError(
            f"env.dynamics={self._spec.id} must step to finite numbers; a step raised, or its state, observation or "
            f"reward was infinite or no number, after {seen}, action {told}"
        )


def action_bounds(spec: EnvironmentSpec) -> NDArray[np.float64]:
    """Return [2, A], lowest and highest value of each entry of an action; [2, 0] where an action is a number."""
    return np.array([spec.action_low, spec.action_high], np.float64)


def ranges(n: int, n_parts: int) -> list[tuple[int, int]]:
    """Return the ranges that divide `n` items into parts of nearly equal length, none of them empty."""
    edges = [part * n // n_parts for part in range(n_parts + 1)] if n > 0 else []
    return [(first, last) for first, last in pairwise(edges) if first < last]
