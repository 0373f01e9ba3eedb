"""The lean way to step a Gymnasium environment: the same steps, without what only looks on."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces, wrappers

from ge_torchrl.environments.making import GymEnvironment

_logger = logging.getLogger(__name__)

# They look on, or keep the order of calls, which the border keeps itself: a tenth of a CartPole step.
_ONLOOKERS = (wrappers.OrderEnforcing, wrappers.PassiveEnvChecker)
# Episodes that a rewritten step is tried on, and their longest; by random actions a lander crashes after 100 steps.
_TRIED_EPISODES = 3
_TRIED_STEPS = 300


class Lean(NamedTuple):
    """How an environment is stepped.

    Attributes:
        step: As `Env.step`.
        reset: As `Env.reset`; called with a seed only.
        limit: Steps after which an episode is to be truncated.
    """

    step: Callable[[Any], tuple[Any, Any, Any, Any, Any]]
    reset: Callable[..., tuple[Any, Any]]
    limit: int


def lean(environment: GymEnvironment, limit: int) -> Lean:
    """Return the quickest way to the same steps.

    The outer wrappers that change nothing are taken off, and `TimeLimit`, whose limit is returned. Asking whether an
    action is one of the environment's gets cheaper. Where nothing else lies around LunarLander, its step is ours.

    Args:
        environment: As `gym.make` gives it; whoever steps it here does not step it by itself.
        limit: Of the episode.
    """
    inner: Any = environment
    while type(inner) in (*_ONLOOKERS, wrappers.TimeLimit):
        if type(inner) is wrappers.TimeLimit:
            if inner.spec is None or inner.spec.max_episode_steps is None:
                break
            limit = min(limit, inner.spec.max_episode_steps)
        inner = inner.env
    _quicken(inner.unwrapped.action_space)
    rewritten = _rewritten(inner)
    stepped = inner if rewritten is None else rewritten(inner)
    return Lean(stepped.step, stepped.reset, limit)


def _quicken(space: Any) -> None:
    """Let a Discrete space answer `contains` at once; Gymnasium's takes a third of a CartPole step."""
    if type(space) is spaces.Discrete and "contains" not in space.__dict__:
        first = int(space.start)
        space.__dict__["contains"] = partial(_contains, first, first + int(space.n), space)


# A function of a module: the environment may pickle or copy its space.
def _contains(first: int, end: int, space: spaces.Discrete[Any], x: Any) -> bool:
    return first <= x < end if type(x) is int else spaces.Discrete.contains(space, x)


def _rewritten(environment: GymEnvironment) -> Callable[[Any], Any] | None:
    """Return a class that steps this environment as it steps itself, where there is one and it does."""
    kind: Any = type(environment)
    if (kind.__module__, kind.__name__) != ("gymnasium.envs.box2d.lunar_lander", "LunarLander"):
        return None
    # Box2D is there: the environment was made.
    from ge_torchrl.environments.lunar_lander import LunarLanderSteps

    lander: Any = environment
    if lander.enable_wind or lander.render_mode is not None:
        return None
    return LunarLanderSteps if _agrees(kind, LunarLanderSteps, lander.continuous) else None


@cache
def _agrees(kind: Any, rewritten: Any, is_continuous: bool) -> bool:
    """Tell whether a rewritten step does what the installed Gymnasium's does, on a few episodes."""
    theirs, inner = kind(continuous=is_continuous), kind(continuous=is_continuous)
    ours = rewritten(inner)
    theirs.action_space.seed(0)
    agrees = all(_same_episode(ours, theirs, seed) for seed in range(_TRIED_EPISODES))
    if not agrees:
        _logger.warning(
            "The installed Gymnasium's %s steps otherwise than expected; it is stepped by itself, more slowly.",
            theirs.__class__.__name__,
        )
    return agrees


def _same_episode(ours: Any, theirs: Any, seed: int) -> bool:
    if not np.array_equal(ours.reset(seed=seed)[0], theirs.reset(seed=seed)[0]):
        return False
    for _ in range(_TRIED_STEPS):
        action = theirs.action_space.sample()
        action = int(action) if np.ndim(action) == 0 else action
        (one, *rest), (other, *others) = ours.step(action), theirs.step(action)
        if not np.array_equal(one, other) or rest[:3] != others[:3]:
            return False
        if rest[1] or rest[2]:
            break
    return True
