"""Heats: searches for the numbers of trees run side by side, and the better ones go on.

Some searches never leave where they begin; that shows early. So after each heat the better half goes on, and the last
one is taken: successive halving (K. Jamieson and A. Talwalkar, "Non-stochastic best arm identification", AISTATS 2016).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

import numpy as np

from ge_torchrl.environments.backend import Backend, LimitReachedError
from ge_torchrl.refiners.strategy import Strategy
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

# Of the searches so many go on into each heat, which take such parts of all steps. Chosen on LunarLander.
_GO_ON: Final = (1.0, 0.5, 0.33, 0.0, 0.0)
_PARTS: Final = (0.25, 0.18, 0.22, 0.175, 0.175)
# Episodes that tell after a heat who goes on.
_JUDGED_ON: Final = 20


def run_heats(
    backend: Backend, strategies: Sequence[Strategy], timesteps: int, purpose: str, rng: np.random.Generator
) -> list[DecisionTree]:
    """Run searches against each other; return the trees of those that came to the end, the best first.

    Where the backend's limit breaks it off, those come back that were still in it.

    Args:
        backend: Measures trees, and counts its steps.
        strategies: The searches, one or more.
        timesteps: Environment steps of all together.
        purpose: What the backend counts the judges' steps under.
        rng: Draws the judges' episodes.
    """
    lanes = [_Lane(strategy) for strategy in strategies]
    purse = _Purse(backend, timesteps)
    with suppress(LimitReachedError):
        for heat, share in enumerate(_GO_ON):
            lanes = lanes[: max(1, round(share * len(strategies)))]
            for place, lane in enumerate(lanes):
                of_what_is_left = _PARTS[heat] / (sum(_PARTS[heat:]) - _PARTS[heat] * place / len(lanes))
                lane.strategy.advance(int(of_what_is_left / len(lanes) * purse.left()))
            lanes = _judged(backend, lanes, purpose, rng)
    return [lane.strategy.tree for lane in lanes if lane.strategy.rounds > 0]


@dataclass(frozen=True, eq=False)
class _Lane:
    """A search in a heat.

    Attributes:
        strategy: Its search.
        last: How its tree did when it was judged last.
    """

    strategy: Strategy
    last: float = -np.inf


class _Purse:
    """What heats may still take: their steps, or fewer where a limit of the backend leaves room for fewer.

    Of a limit in seconds there are as many as they make at the speed so far: it is another for each tree, and for each
    machine's load.
    """

    def __init__(self, backend: Backend, timesteps: int) -> None:
        self._backend, self._timesteps = backend, timesteps
        self._started, self._first = time.perf_counter(), backend.steps.total()

    def left(self) -> float:
        total, now, limit = self._backend.steps.total(), time.perf_counter(), self._backend.limit
        done = total - self._first
        left: float = self._timesteps - done
        if limit is not None and limit.max_env_steps is not None:
            left = min(left, limit.max_env_steps - total)
        if limit is not None and done > 0:
            left = min(left, (limit.deadline - now) * done / (now - self._started))
        return max(0.0, left)


def _judged(backend: Backend, lanes: Sequence[_Lane], purpose: str, rng: np.random.Generator) -> list[_Lane]:
    """Return the lanes in the order of their returns on new common episodes."""
    if len(lanes) == 1:
        return list(lanes)
    seeds = episode_seeds("training", _JUDGED_ON, rng)
    forests = [Forest.stack([lane.strategy.tree]) for lane in lanes]
    returns = [backend.evaluate(forest, seeds, purpose).returns.mean() for forest in forests]
    judged = [_Lane(lane.strategy, float(mean)) for lane, mean in zip(lanes, returns, strict=True)]
    return sorted(judged, key=lambda lane: -lane.last)
