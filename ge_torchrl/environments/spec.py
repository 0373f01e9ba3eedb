"""What an environment is to us: names, units, bounds, episode limit and threshold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ge_torchrl.config import EnvironmentConfig
from ge_torchrl.environments.hangs import LONGEST_STEP_SECONDS
from ge_torchrl.environments.making import GymEnvironment, make
from ge_torchrl.environments.naming import action_names, feature_names
from ge_torchrl.environments.plants.plant import names_plant, read_plant
from ge_torchrl.environments.suitable import (
    action_bounds,
    float32_bounds,
    observed_box,
    space_of,
)
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.trees.controller import Names

# An environment without an episode limit of its own gets this one, so that a run always ends.
UNBOUNDED_EPISODE_STEPS = 100_000


@dataclass(frozen=True, eq=False)
class EnvironmentSpec:
    """An environment with a flat Box observation, and Discrete actions or a flat Box of them.

    Attributes:
        id: What `gym.make` takes: a Gymnasium id, with a `module:` in front where a module registers it. Or a user's
            own dynamics, `file.py:Class`; see `plants`.
        names: How the environment is made, and the names of its features, units and actions.
        low: [D] float32, lower bounds that the environment declares, possibly infinite and possibly untrue: what was
            seen of them is in `GymnasiumBackend.bounds`.
        high: [D] float32, upper bounds.
        max_episode_steps: Steps after which an episode is truncated.
        has_limit: Whether that limit is the environment's or the user's own.
        first_action: The number of the first action (`Discrete(n, start=first_action)`), nearly always 0. Trees count
            from 0 everywhere; the environment is given its own number at the border.
        solved_at: Mean return from which the task counts as solved; None where there is no such agreement.
        step_seconds: How long a step or a reset may take, before it is taken to hang [s].
    """

    id: str
    names: Names
    low: NDArray[np.float32]
    high: NDArray[np.float32]
    max_episode_steps: int
    has_limit: bool
    first_action: int
    solved_at: float | None
    step_seconds: float = LONGEST_STEP_SECONDS

    @property
    def n_features(self) -> int:
        """Number of entries of an observation, D."""
        return len(self.names.features)

    @property
    def n_actions(self) -> int:
        """Number of actions, or of entries of a continuous action, A."""
        return len(self.names.actions)

    @property
    def is_continuous(self) -> bool:
        """Whether an action is A numbers, and not one of A choices."""
        return bool(self.names.action_bounds)

    @property
    def action_low(self) -> NDArray[np.float32]:
        """[A] lower bounds of a continuous action, possibly infinite; [0] where actions are choices."""
        return np.array([low for low, _ in self.names.action_bounds], np.float32)

    @property
    def action_high(self) -> NDArray[np.float32]:
        """[A] upper bounds, likewise."""
        return np.array([high for _, high in self.names.action_bounds], np.float32)

    def is_solved(self, mean_return: float) -> bool:
        """Tell whether a mean return reaches the threshold; False where there is none."""
        return self.solved_at is not None and mean_return >= self.solved_at


def make_gymnasium(
    environment: EnvironmentSpec | str, max_episode_steps: int | None = None, render_mode: str | None = None
) -> GymEnvironment:
    """Make the Gymnasium environment.

    Args:
        environment: A description, whose limit, arguments and wrappers are kept, or an id.
        max_episode_steps: Episode limit for an id; None takes the environment's own.
        render_mode: As `gym.make` takes it.

    Raises:
        EnvironmentFaultError: It is unknown or cannot be made, with the reason and the remedy where one is known.
    """
    if isinstance(environment, str):
        return make(environment, max_episode_steps, {}, (), render_mode)
    limit = environment.max_episode_steps if environment.has_limit else None
    return make(environment.id, limit, environment.names.kwargs, environment.names.wrappers, render_mode)


def describe(
    environment_id: str,
    features: tuple[str, ...] = (),
    units: tuple[str, ...] = (),
    actions: tuple[str, ...] = (),
    solved_at: float | None = None,
    max_episode_steps: int | None = None,
    kwargs: Mapping[str, Any] | None = None,
    wrappers: Sequence[str] = (),
) -> EnvironmentSpec:
    """Describe a Gymnasium environment, with names for what it calls by number.

    Args:
        environment_id: What `gym.make` takes, or a plant, `file.py:Class`.
        features: [D] names; none means those that Gymnasium knows, of the keys of a Dict that was flattened, else
            `x0, x1, ...`.
        units: [D] units; none means no units.
        actions: [A] names of the actions, or of the entries of a continuous one; none means those of a plant, the
            values of a continuous action that is cut into bins, else `a0, a1, ...`.
        solved_at: Mean return from which the task is solved; None takes the environment's registered threshold.
        max_episode_steps: Episode limit; None takes the environment's own.
        kwargs: What else `gym.make` is given; of a plant, what takes the place of numbers in its file.
        wrappers: Wrappers to put around it, innermost first, each written `module:Class`, or
            `module:Class {key: value}` with arguments.

    Raises:
        EnvironmentFaultError: The environment is unknown, its observations are no flat Box, its actions are neither
            Discrete nor a flat Box of floats, or the names do not fit them.
    """
    given = dict(kwargs or {})
    found = _found(environment_id, max_episode_steps, given, wrappers)
    n_features, n_actions = len(found.features), len(found.actions)
    _check_number("features", features, n_features, environment_id)
    _check_number("units", units, n_features, environment_id)
    _check_number("actions", actions, n_actions, environment_id)
    low, high = float32_bounds(found.observed)
    return EnvironmentSpec(
        id=environment_id,
        names=Names(
            id=environment_id,
            features=features or found.features,
            units=units or found.units,
            actions=actions or found.actions,
            kwargs=given,
            wrappers=tuple(wrappers),
            max_episode_steps=max_episode_steps,
            action_bounds=found.action_bounds,
            source=found.source,
        ),
        low=low,
        high=high,
        max_episode_steps=found.limit or UNBOUNDED_EPISODE_STEPS,
        has_limit=found.limit is not None,
        first_action=found.first_action,
        solved_at=found.solved_at if solved_at is None else solved_at,
    )


def describe_settings(env: EnvironmentConfig) -> EnvironmentSpec:
    """Describe the environment that the settings of a run name; see `describe`."""
    if env.dynamics is not None:
        read_plant(env.dynamics)
    described = describe(
        env.id,
        env.features,
        env.units,
        env.actions,
        env.solved_at,
        env.max_episode_steps,
        env.kwargs,
        env.wrappers,
    )
    return replace(described, step_seconds=env.step_seconds)


def symmetry_of(env: EnvironmentConfig) -> Mapping[str, Any]:
    """Return the mirror that the settings declare, else the one that a plant declares; where they say null, none."""
    if env.symmetry is None:
        return {}
    return env.symmetry or (read_plant(env.id, env.kwargs).symmetry if names_plant(env.id) else {})


@dataclass(frozen=True, eq=False)
class _Found:
    """What an environment that was made says of itself; see `EnvironmentSpec`."""

    observed: spaces.Box
    action_bounds: tuple[tuple[float, float], ...]
    first_action: int
    features: tuple[str, ...]
    units: tuple[str, ...]
    actions: tuple[str, ...]
    source: str
    limit: int | None
    solved_at: float | None


def _found(
    environment_id: str, max_episode_steps: int | None, kwargs: Mapping[str, Any], wrappers: Sequence[str]
) -> _Found:
    """Make an environment, look at it and close it."""
    own = read_plant(environment_id, kwargs) if names_plant(environment_id) else None
    environment = make(environment_id, max_episode_steps, kwargs, wrappers)
    try:
        action_space, registered = space_of(environment, "action_space", environment_id), environment.spec
        observation_space = space_of(environment, "observation_space", environment_id)
        observed = observed_box(observation_space, environment_id, wrappers)
        bounds = action_bounds(action_space, environment_id, wrappers)
        features = feature_names(environment)
        n_actions = int(action_space.n) if isinstance(action_space, spaces.Discrete) else len(bounds)
        actions = action_names(environment, n_actions, () if own is None else own.actions.names)
    finally:
        environment.close()
    units = ("",) * len(features)
    # Wrappers may have changed what is observed.
    if own is not None and len(features) == len(own.features):
        features, units = own.features, own.units
    return _Found(
        observed=observed,
        action_bounds=bounds,
        first_action=int(action_space.start) if isinstance(action_space, spaces.Discrete) else 0,
        features=features,
        units=units,
        actions=actions,
        source="" if own is None else own.source,
        limit=None if registered is None else registered.max_episode_steps,
        solved_at=None if registered is None else registered.reward_threshold,
    )


def _check_number(what: str, names: tuple[str, ...], expected: int, environment_id: str) -> None:
    if names and len(names) != expected:
        raise EnvironmentFaultError(
            f"env.{what} must name the {expected} {what} of {environment_id}, or none (env.{what}=[]); "
            f"got {len(names)} names"
        )
