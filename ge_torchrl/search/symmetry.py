"""Whether an environment has the mirror that was declared, asked of its returns.

Of an environment with a mirror, a tree and its image in it return the same on the average, whatever the tree. So trees
of all kinds, drawn at random, play beside their images, each on episodes of its own; what differs by more than luck
refutes the mirror. What does not differ proves nothing, but the search that believes it loses little.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.errors import ConfigError
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.ge.operators import random_population
from ge_torchrl.search.problem import Problem
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.forest import Forest

MIRROR = "asking the mirror"
"""The purpose that steps of the check are counted under."""

_TREES: Final = 12
_EPISODES: Final = 40
# Standard errors of a difference that luck does not make in a dozen trees: once in forty thousand checks.
_REFUTED_AT: Final = 5.0


def check_mirror(problem: Problem) -> None:
    """Refuse a mirror that the environment does not have; nothing is asked where nothing uses it.

    Args:
        problem: What is searched.

    Raises:
        ConfigError: A tree and its image return so different sums that the mirror is refuted.
        LimitReachedError: The backend's limit was reached first.
    """
    mirror, config = problem.mirror, problem.config
    if mirror is None or not (problem.has_sums or config.archive.races > 0):
        return
    rng = stream(config.seed, "mirror")
    codons = random_population(4 * _TREES, config.ge.genotype_length, rng)
    drawn = map_population(codons, problem.tables, config.ge.wraps)
    trees = drawn.take(np.flatnonzero(drawn.valid)[:_TREES]).trees()
    images = [mirror.tree(tree) for tree in trees]
    seeds = episode_seeds("training", 2 * _EPISODES, rng)
    own, others = np.split(seeds, 2)
    returns = problem.backend.evaluate(Forest.stack(trees), own, MIRROR).returns
    mirrored = problem.backend.evaluate(Forest.stack(images), others, MIRROR).returns
    for one, other in zip(returns, mirrored, strict=True):
        if standard_errors_apart(one, other) > _REFUTED_AT:
            raise ConfigError(
                f"env.symmetry is refuted: a tree returns {one.mean():.5g} and its image in the mirror "
                f"{other.mean():.5g}, means over {_EPISODES} episodes with standard errors of {_error(one):.2g} and "
                f"{_error(other):.2g}; mend it, or type '~env.symmetry' to do without"
            )


def standard_errors_apart(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Return how many standard errors of the difference two means lie apart; 0 where they are equal.

    Args:
        one: [E] returns.
        other: [E] returns of other episodes.
    """
    difference = abs(float(one.mean() - other.mean()))
    # Where all episodes of a tree return nearly the same, the sums of rewards differ by rounding.
    error = math.hypot(_error(one), _error(other), 1e-6 * max(1.0, abs(float(one.mean()))))
    return difference / error


def _error(returns: NDArray[np.float64]) -> float:
    return float(returns.std(ddof=1)) / math.sqrt(len(returns))
