"""What an environment is to us: names, units, bounds, episode limit and threshold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import load_env_creator
from numpy.typing import NDArray

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
        id: What `gym.make` takes: a Gymnasium id, with a `module:` in front where a module registers it.
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


def registered_id(environment_id: str) -> str:
    """Return the id as Gymnasium's registry knows it: without `module:`, which is for `gym.make` alone."""
    return environment_id.rpartition(":")[2]


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
        environment_id: What `gym.make` takes.
        features: [D] names; none means `x0, x1, ...`.
        units: [D] units; none means no units.
        actions: [A] names of the actions, or of the entries of a continuous one; none means `a0, a1, ...`.
        solved_at: Mean return from which the task is solved; None takes the environment's registered threshold.
        max_episode_steps: Episode limit; None takes the environment's own.
        kwargs: What else `gym.make` is given.
        wrappers: Wrappers to put around it, innermost first, each written `module:Class`.

    Raises:
        EnvironmentFaultError: The environment is unknown, its observations are no flat Box, its actions are neither
            Discrete nor a flat Box of floats, or the names do not fit them.
    """
    given = dict(kwargs or {})
    environment = _make(environment_id, max_episode_steps, given, wrappers, None)
    observation_space, action_space, registered = (
        environment.observation_space,
        environment.action_space,
        environment.spec,
    )
    environment.close()
    if not isinstance(observation_space, spaces.Box) or len(observation_space.shape) != 1:
        raise EnvironmentFaultError(
            f"env.id={environment_id} must observe a flat Box, since a split compares one number; got "
            f"{_one_line(observation_space)} (gymnasium.wrappers.FlattenObservation makes one)"
        )
    action_bounds = _action_bounds(action_space, environment_id)
    n_features = observation_space.shape[0]
    n_actions = int(action_space.n) if isinstance(action_space, spaces.Discrete) else len(action_bounds)
    _check_number("features", features, n_features, environment_id)
    _check_number("units", units, n_features, environment_id)
    _check_number("actions", actions, n_actions, environment_id)
    limit = registered.max_episode_steps if registered is not None else None
    threshold = registered.reward_threshold if registered is not None else None
    low, high = _float32_bounds(observation_space)
    return EnvironmentSpec(
        id=environment_id,
        names=Names(
            id=environment_id,
            features=features or tuple(f"x{i}" for i in range(n_features)),
            units=units or ("",) * n_features,
            actions=actions or tuple(f"a{i}" for i in range(n_actions)),
            kwargs=given,
            wrappers=tuple(wrappers),
            max_episode_steps=max_episode_steps,
            action_bounds=action_bounds,
        ),
        low=low,
        high=high,
        max_episode_steps=limit or UNBOUNDED_EPISODE_STEPS,
        has_limit=limit is not None,
        first_action=int(action_space.start) if isinstance(action_space, spaces.Discrete) else 0,
        solved_at=threshold if solved_at is None else solved_at,
    )


def _make(
    environment_id: str,
    max_episode_steps: int | None,
    kwargs: Mapping[str, Any],
    wrappers: Sequence[str],
    render_mode: str | None,
) -> GymEnvironment:
    given = dict(kwargs) if render_mode is None else {**kwargs, "render_mode": render_mode}
    try:
        # Our own border checks what comes back, and names the seed, step and action with it.
        environment: GymEnvironment = gym.make(
            environment_id, max_episode_steps=max_episode_steps, disable_env_checker=True, **given
        )
        for wrapper in wrappers:
            wrap: Any = load_env_creator(wrapper)
            environment = wrap(environment)
    except gym.error.DependencyNotInstalled as error:
        raise EnvironmentFaultError(
            f"env.id={environment_id} needs packages that are not installed ({_one_line(error)}); "
            f'for Box2D environments: pip install -c constraints.txt -e ".[box2d]"'
        ) from error
    except (gym.error.Error, ImportError) as error:
        raise EnvironmentFaultError(
            f"env.id must be the id of an installed Gymnasium environment, as in env.id=CartPole-v1 or "
            f"env.id=module:Name-v0; got {environment_id!r} ({_one_line(error)})"
        ) from error
    except FAULTS as error:
        raise EnvironmentFaultError(f"env.id={environment_id} raised {error!r} while it was made") from error
    return environment


def _action_bounds(space: spaces.Space[Any], environment_id: str) -> tuple[tuple[float, float], ...]:
    """Return the bounds of each entry of a continuous action, none for a choice; refuse what is neither."""
    if isinstance(space, spaces.Discrete):
        return ()
    if isinstance(space, spaces.Box) and len(space.shape) == 1 and space.shape[0] and space.dtype.kind == "f":
        low, high = _float32_bounds(space)
        return tuple(zip(low.tolist(), high.tolist(), strict=True))
    raise EnvironmentFaultError(
        f"env.id={environment_id} must have Discrete actions, or a flat Box of floats, since a leaf holds one choice "
        f"or a row of numbers; got {_one_line(space)}"
    )


def _float32_bounds(space: spaces.Box) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    # A float64 bound may lie beyond every float32: it is none.
    with np.errstate(over="ignore"):
        return space.low.astype(np.float32), space.high.astype(np.float32)


def _check_number(what: str, names: tuple[str, ...], expected: int, environment_id: str) -> None:
    if names and len(names) != expected:
        raise EnvironmentFaultError(
            f"env.{what} must name the {expected} {what} of {environment_id}, or none (env.{what}=[]); "
            f"got {len(names)} names"
        )


def _one_line(value: object) -> str:
    return " ".join(str(value).split())
