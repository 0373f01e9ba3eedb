"""What an environment is to us: names, units, bounds, episode limit and threshold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
import yaml
from gymnasium import spaces
from gymnasium.envs.registration import load_env_creator
from numpy.typing import NDArray

from ge_torchrl.config import EnvironmentConfig
from ge_torchrl.environments.naming import feature_names
from ge_torchrl.environments.plants.environment import register_plant
from ge_torchrl.environments.plants.plant import names_plant, read_plant
from ge_torchrl.environments.registry import find_registered
from ge_torchrl.environments.suitable import (
    action_bounds,
    float32_bounds,
    observed_box,
    one_line,
    space_of,
)
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.trees.controller import Names

# An environment without an episode limit of its own gets this one, so that a run always ends.
UNBOUNDED_EPISODE_STEPS = 100_000
# What an environment raises is its fault, an attempt to end the program too; Ctrl-C is the user's.
FAULTS = (Exception, SystemExit)

# What `gym.make` gives: observations and actions are whatever the spaces say.
GymEnvironment = gym.Env[Any, Any]


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
    """

    id: str
    names: Names
    low: NDArray[np.float32]
    high: NDArray[np.float32]
    max_episode_steps: int
    has_limit: bool
    first_action: int
    solved_at: float | None

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
        return _make(environment, max_episode_steps, {}, (), render_mode)
    limit = environment.max_episode_steps if environment.has_limit else None
    return _make(environment.id, limit, environment.names.kwargs, environment.names.wrappers, render_mode)


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
        actions: [A] names of the actions, or of the entries of a continuous one; none means `a0, a1, ...`.
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
    environment = _make(environment_id, max_episode_steps, given, wrappers, None)
    try:
        action_space, registered = space_of(environment, "action_space", environment_id), environment.spec
        observation_space = space_of(environment, "observation_space", environment_id)
        observed = observed_box(observation_space, environment_id, wrappers)
        bounds = action_bounds(action_space, environment_id, wrappers)
        found_names = feature_names(environment)
    finally:
        environment.close()
    n_features = observed.shape[0]
    n_actions = int(action_space.n) if isinstance(action_space, spaces.Discrete) else len(bounds)
    source = ""
    if names_plant(environment_id):
        own = read_plant(environment_id, given)
        source = own.source
        # Wrappers may have changed what is observed, or what can be done.
        if n_features == len(own.features):
            features, units = features or own.features, units or own.units
        if n_actions == len(own.actions.names):
            actions = actions or own.actions.names
    _check_number("features", features, n_features, environment_id)
    _check_number("units", units, n_features, environment_id)
    _check_number("actions", actions, n_actions, environment_id)
    limit = registered.max_episode_steps if registered is not None else None
    threshold = registered.reward_threshold if registered is not None else None
    low, high = float32_bounds(observed)
    return EnvironmentSpec(
        id=environment_id,
        names=Names(
            id=environment_id,
            features=features or found_names,
            units=units or ("",) * n_features,
            actions=actions or tuple(f"a{i}" for i in range(n_actions)),
            kwargs=given,
            wrappers=tuple(wrappers),
            max_episode_steps=max_episode_steps,
            action_bounds=bounds,
            source=source,
        ),
        low=low,
        high=high,
        max_episode_steps=limit or UNBOUNDED_EPISODE_STEPS,
        has_limit=limit is not None,
        first_action=int(action_space.start) if isinstance(action_space, spaces.Discrete) else 0,
        solved_at=threshold if solved_at is None else solved_at,
    )


def describe_settings(env: EnvironmentConfig) -> EnvironmentSpec:
    """Describe the environment that the settings of a run name; see `describe`."""
    if env.dynamics is not None:
        read_plant(env.dynamics)
    return describe(
        env.id,
        env.features,
        env.units,
        env.actions,
        env.solved_at,
        env.max_episode_steps,
        env.kwargs,
        env.wrappers,
    )


def symmetry_of(env: EnvironmentConfig) -> Mapping[str, Any]:
    """Return the mirror that the settings declare, else the one that a plant declares; where they say null, none."""
    if env.symmetry is None:
        return {}
    return env.symmetry or (read_plant(env.id, env.kwargs).symmetry if names_plant(env.id) else {})


def _make(
    environment_id: str,
    max_episode_steps: int | None,
    kwargs: Mapping[str, Any],
    wrappers: Sequence[str],
    render_mode: str | None,
) -> GymEnvironment:
    given = dict(kwargs) if render_mode is None else {**kwargs, "render_mode": render_mode}
    if names_plant(environment_id):
        environment_id, given = register_plant(environment_id, given), {}
    try:
        find_registered(environment_id)
        # Our own border checks what comes back, and names the seed, step and action with it.
        environment: GymEnvironment = gym.make(
            environment_id, max_episode_steps=max_episode_steps, disable_env_checker=True, **given
        )
    except EnvironmentFaultError:
        raise
    except gym.error.DependencyNotInstalled as error:
        raise EnvironmentFaultError(
            f"env.id={environment_id} needs packages that are not installed ({one_line(error)}); "
            f'for Box2D environments: pip install -c constraints.txt -e ".[box2d]"'
        ) from error
    except gym.error.DeprecatedEnv as error:
        raise EnvironmentFaultError(f"env.id={environment_id}: {one_line(error)}") from error
    except (gym.error.Error, ImportError) as error:
        raise EnvironmentFaultError(
            f"env.id must be the id of an installed Gymnasium environment, as in env.id=CartPole-v1, with the module "
            f"that registers it in front unless that is Gymnasium itself, as in env.id=module:Name-v0; "
            f"got {environment_id!r} ({one_line(error)})"
        ) from error
    except FAULTS as error:
        with_kwargs = f" with env.kwargs={dict(kwargs)}" if kwargs else ""
        raise EnvironmentFaultError(
            f"env.id={environment_id} raised {error!r} while it was made{with_kwargs}"
        ) from error
    for wrapper in wrappers:
        environment = _wrapped(environment, wrapper)
    return environment


def _wrapped(environment: GymEnvironment, wrapper: str) -> GymEnvironment:
    """Put a wrapper around an environment; its name is looked up, its arguments are read, nothing is evaluated."""
    name, _, text = wrapper.partition(" ")
    if name.count(":") != 1:
        raise EnvironmentFaultError(
            f"env.wrappers must be names such as gymnasium.wrappers:FlattenObservation, with one colon; "
            f"got {wrapper!r}; type env.wrappers='[{_with_colon(name)}]'"
        )
    try:
        arguments = dict(yaml.safe_load(text) if text.strip() else {})
        wrap: Any = load_env_creator(name)
        is_wrapper = isinstance(wrap, type) and issubclass(wrap, gym.Wrapper)
    except (ValueError, TypeError, ImportError, AttributeError, yaml.YAMLError) as error:
        raise EnvironmentFaultError(
            f"env.wrappers must be names such as gymnasium.wrappers:FlattenObservation, or with arguments "
            f'"gymnasium.wrappers:DiscretizeAction {{bins: 7}}"; got {wrapper!r} ({one_line(error)})'
        ) from error
    if not is_wrapper:
        raise EnvironmentFaultError(
            f"env.wrappers must be subclasses of gymnasium.Wrapper; got {name}, {wrap}"
        )
    try:
        wrapped: GymEnvironment = wrap(environment, **arguments)
    except FAULTS as error:
        raise EnvironmentFaultError(
            f"env.wrappers: {wrapper} raised {error!r} around {environment.unwrapped}"
        ) from error
    return wrapped


def _with_colon(name: str) -> str:
    """Return a wrapper's name with a colon in front of its class; one of Gymnasium's own may stand alone."""
    module, _, wrapper = name.replace(":", ".").rpartition(".")
    return f"{module or 'gymnasium.wrappers'}:{wrapper}"


def _check_number(what: str, names: tuple[str, ...], expected: int, environment_id: str) -> None:
    if names and len(names) != expected:
        raise EnvironmentFaultError(
            f"env.{what} must name the {expected} {what} of {environment_id}, or none (env.{what}=[]); "
            f"got {len(names)} names"
        )
