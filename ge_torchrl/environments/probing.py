"""What play shows of an environment: the range of each feature, whether episodes end, whether seeds are obeyed.

Everything here depends on the environment alone, with always as many steps, so that every run of it finds the same;
only of very slow environments, or where a run has little time, fewer steps are made.
"""

from __future__ import annotations

import json
import logging
import math
import statistics
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.border import Border, random_action
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.environments.witness import Witness
from ge_torchrl.seeding import episode_seeds, stream

_logger = logging.getLogger(__name__)

_PROBED_STEPS = 3000
# Where the first steps take longer [s], fewer are made, so that it is done in some ten seconds.
_TIMED_STEPS = 50
_PROBED_STEPS_WHERE_SLOW = ((2.5, 100), (0.25, 600))
# After so long [s] it ends in any case, but not before so many observations: of fewer no grammar could be made.
_LONGEST_SECONDS = 20.0
_FEWEST = 10
# Episodes are cut here, so that several are seen; one that did not end may well never end.
_LONGEST_EPISODE = 500
# Steps before trees act, whose thresholds are among what was observed.
_BEFORE_TREES = 300
# A random policy that holds on to its actions comes further than one that trembles.
_NEW_ACTION_PROBABILITY = 0.1
# An episode without a limit of its own may be so many times as long as the longest that was seen.
_TIMES_THE_LONGEST = 10
_SHORTEST_LIMIT, _LONGEST_LIMIT = 1000, 100_000
# Declared bounds that are so many times as wide as what is seen tell nothing of where it lies.
_MOST_TIMES_AS_WIDE = 4.0
_QUANTILES = (0.005, 0.995)
# Steps of the episode that is played twice.
_REPEATED_STEPS = 50
# Fewer of a slow environment [s].
_REPEATED_SECONDS = 2.0
_REPEATED_SEED = 7

Policy = Callable[[NDArray[np.float32]], Any]
"""Answers an observation [D] with an action."""


@dataclass(frozen=True, eq=False)
class Probe:
    """What play showed.

    Attributes:
        ranges: (low, high) of the values that each feature takes in play, finite: the declared bounds where they are
            true and near to what was seen, else quantiles of that; twice the same value where it does not vary.
        binary: Numbers of the features that were seen at 0 and at 1, and nowhere else.
        seen_low: [D] float32, the smallest values seen.
        seen_high: [D] float32, the largest.
        outside: A value of each feature that was seen outside its declared bounds.
        longest: Steps of the longest episode.
        ended: Whether every episode ended before it was cut.
        steps: How many observations all this is from.
    """

    ranges: tuple[tuple[float, float], ...]
    binary: tuple[int, ...]
    seen_low: NDArray[np.float32]
    seen_high: NDArray[np.float32]
    outside: dict[int, float]
    longest: int
    ended: bool
    steps: int

    @property
    def limit(self) -> int:
        """An episode limit for an environment that has none."""
        limit = self.longest * _TIMES_THE_LONGEST if self.ended else _SHORTEST_LIMIT
        return min(max(limit, _SHORTEST_LIMIT), _LONGEST_LIMIT)


_probes: dict[str, Probe] = {}
_obedient: dict[str, bool] = {}


def probe(spec: EnvironmentSpec, seconds: float = math.inf) -> Probe:
    """Act at random, then by small random trees, and return what was seen; done once in a process.

    Args:
        spec: The environment.
        seconds: How long it may take where that is less than usual [s].

    Raises:
        EnvironmentFaultError: The environment is at fault.
    """
    made = _as_made(spec, seconds)
    if made not in _probes:
        _probes[made] = _play(spec, min(seconds, _LONGEST_SECONDS))
    return _probes[made]


def obeys_seeds(spec: EnvironmentSpec, seconds: float = math.inf) -> bool:
    """Tell whether the same seed gives the same episode twice, the same actions taken; found out once in a process.

    Args:
        spec: The environment.
        seconds: How long it may take where that is less than usual [s].

    Raises:
        EnvironmentFaultError: The environment is at fault.
    """
    made = _as_made(spec, seconds)
    if made not in _obedient:
        with closing(Border(spec, Witness(spec))) as border:
            first = _episode(border, spec, _REPEATED_STEPS, min(_REPEATED_SECONDS, seconds / 2))
            _obedient[made] = first == _episode(border, spec, len(first) - 1, math.inf)
    return _obedient[made]


def _as_made(spec: EnvironmentSpec, seconds: float) -> str:
    names = spec.names
    return json.dumps(
        [names.id, names.kwargs, names.wrappers, names.max_episode_steps, names.source, seconds],
        sort_keys=True,
    )


def _episode(border: Border, spec: EnvironmentSpec, n_steps: int, seconds: float) -> list[Any]:
    rng, deadline = (
        stream(0, "the actions of an episode that is played twice"),
        time.perf_counter() + seconds,
    )
    told: list[Any] = [border.reset(_REPEATED_SEED)]
    for _ in range(n_steps):
        outcome = border.step(random_action(spec, rng))
        told.append(outcome)
        if outcome[2] or outcome[3] or time.perf_counter() > deadline:
            break
    return told


def _play(spec: EnvironmentSpec, seconds: float) -> Probe:
    rng, witness = stream(0, "probe of the environment"), Witness(spec)
    seeds = iter(episode_seeds("training", _PROBED_STEPS, stream(0, "episodes of the probe")).tolist())
    seen: list[NDArray[np.float32]] = []
    lengths, ended_all, episode, n_steps = [0], True, 0, _PROBED_STEPS
    with closing(Border(spec, witness)) as border:
        clock = [time.perf_counter()]
        while len(seen) < n_steps:
            border.reset(next(seeds))
            seen.append(border.array.copy())
            policy = _policy(episode, spec, rng, seen)
            length, ended = 0, False
            while not ended and length < _LONGEST_EPISODE and len(seen) < n_steps:
                _, _, terminated, truncated = border.step(policy(seen[-1]))
                seen.append(border.array.copy())
                length, ended = length + 1, terminated or truncated
                clock.append(time.perf_counter())
                n_steps = _affordable(n_steps, len(seen), clock, seconds)
            ended_all &= ended or length < _LONGEST_EPISODE
            lengths.append(length)
            episode += 1
        if n_steps < _PROBED_STEPS:
            _logger.warning(
                "%s makes %g steps a second here: it was looked at for %d steps before the run.",
                spec.id,
                float(f"{n_steps / (clock[-1] - clock[0]):.2g}"),
                n_steps,
            )
    observed = np.array(seen[:n_steps])
    ranges = tuple(_range(spec, feature, column, witness) for feature, column in enumerate(observed.T))
    binary = tuple(
        feature for feature, column in enumerate(observed.T) if np.unique(column).tolist() == [0.0, 1.0]
    )
    return Probe(
        ranges,
        binary,
        observed.min(axis=0),
        observed.max(axis=0),
        witness.outside,
        max(lengths),
        ended_all,
        n_steps,
    )


def _affordable(n_steps: int, n_done: int, clock: Sequence[float], at_most: float) -> int:
    """Return how many of `n_steps` steps are made where the clock showed so much after each so far [s]."""
    if n_done >= _FEWEST and clock[-1] - clock[0] > at_most:
        return min(n_steps, n_done)
    # One of two: either may be the first of an episode.
    if n_done in {_TIMED_STEPS, _TIMED_STEPS + 1}:
        # Other programs hold up a few steps; what is found must not depend on them.
        usual = statistics.median(after - before for before, after in pairwise(clock))
        for slow, few in _PROBED_STEPS_WHERE_SLOW:
            if usual * _TIMED_STEPS > slow:
                return min(n_steps, few)
    return n_steps


def _policy(
    episode: int, spec: EnvironmentSpec, rng: np.random.Generator, seen: list[NDArray[np.float32]]
) -> Policy:
    """Return the policy of an episode: trembling, persistent or a tree, in turn."""
    if episode % 3 == 0 or len(seen) < _BEFORE_TREES:
        return lambda _: random_action(spec, rng)
    if episode % 3 == 1:
        return _persistent(spec, rng)
    return random_tree(spec, rng, seen, 2)


def _persistent(spec: EnvironmentSpec, rng: np.random.Generator) -> Policy:
    action = random_action(spec, rng)

    def act(_: NDArray[np.float32]) -> Any:
        nonlocal action
        if rng.random() < _NEW_ACTION_PROBABILITY:
            action = random_action(spec, rng)
        return action

    return act


def random_tree(
    spec: EnvironmentSpec, rng: np.random.Generator, seen: Sequence[NDArray[np.float32]], depth: int
) -> Policy:
    """Return a full tree of random splits and actions.

    Args:
        spec: The environment.
        rng: Source of randomness.
        seen: Observations, among which thresholds are chosen.
        depth: Of the tree; 0 for one action.
    """
    if depth == 0:
        action = random_action(spec, rng)
        return lambda _: action
    feature = int(rng.integers(spec.n_features))
    threshold = seen[int(rng.integers(len(seen)))][feature]
    left, right = random_tree(spec, rng, seen, depth - 1), random_tree(spec, rng, seen, depth - 1)
    return lambda observation: (left if observation[feature] < threshold else right)(observation)


def _range(
    spec: EnvironmentSpec, feature: int, column: NDArray[np.float32], witness: Witness
) -> tuple[float, float]:
    low, high = (float(str(bound[feature])) + 0.0 for bound in (spec.low, spec.high))
    finite = column[np.isfinite(column)].astype(np.float64)
    if len(finite) == 0:
        finite = np.zeros(1)
    is_true = feature not in witness.outside and high - low < math.inf
    span = max(float(np.ptp(finite)), 1.0 if len(np.unique(finite)) <= 2 else 0.0)
    if is_true and high - low <= _MOST_TIMES_AS_WIDE * span:
        return low, high
    first, last = np.quantile(finite, _QUANTILES).tolist()
    if first == last:
        first, last = float(finite.min()), float(finite.max())
        if first == last:
            return first, last
    # A hundredth of the width is as exactly as quantiles of a few thousand steps are known.
    unit = 10.0 ** math.floor(math.log10(last - first) - 1)
    first, last = (
        round(math.floor(first / unit) * unit, 12),
        round(math.ceil(last / unit) * unit, 12),
    )
    return (max(low, first), min(high, last)) if is_true else (first, last)
