"""What an environment is to us: names, units, bounds, episode limit and threshold."""

from __future__ import annotations

from dataclasses import dataclass

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.trees.labels import TreeLabels

# An environment without an episode limit of its own gets this one, so that a run always ends.
UNBOUNDED_EPISODE_STEPS = 100_000


@dataclass(frozen=True, eq=False)
class EnvironmentSpec:
    """An environment with a flat Box observation and Discrete actions.

    Attributes:
        id: Gymnasium id.
        labels: Names of features, units and actions, [D] and [A].
        low: [D] float32, lower bounds of the observation space, possibly infinite.
        high: [D] float32, upper bounds.
        max_episode_steps: Steps after which an episode is truncated.
        has_limit: Whether that limit is the environment's or the user's own; without one, an episode that reaches
            UNBOUNDED_EPISODE_STEPS is a fault.
        first_action: The number of the first action (`Discrete(n, start=first_action)`), nearly always 0.
        solved_at: Mean return from which the task counts as solved; None where there is no such agreement.
    """

    id: str
    labels: TreeLabels
    low: NDArray[np.float32]
    high: NDArray[np.float32]
    max_episode_steps: int
    has_limit: bool
    first_action: int
    solved_at: float | None

    @property
    def n_features(self) -> int:
        """Number of entries of an observation, D."""
        return len(self.labels.features)

    @property
    def n_actions(self) -> int:
        """Number of actions, A."""
        return len(self.labels.actions)

    def is_solved(self, mean_return: float) -> bool:
        """Tell whether a mean return reaches the threshold; False where there is none."""
        return self.solved_at is not None and mean_return >= self.solved_at


def make_gymnasium(
    environment_id: str, max_episode_steps: int | None = None
) -> gym.Env[NDArray[np.float32], int]:
    """Make the Gymnasium environment.

    Raises:
        EnvironmentFaultError: It is unknown or cannot be made, with the reason and the remedy where one is known.
    """
    try:
        # Our own routes check what comes back, and name the seed, step and action with it.
        return gym.make(environment_id, max_episode_steps=max_episode_steps, disable_env_checker=True)
    except gym.error.DependencyNotInstalled as error:
        raise EnvironmentFaultError(
            f"env.id={environment_id} needs packages that are not installed ({error}); "
            f'for Box2D environments: pip install "ge-torchrl[box2d]"'
        ) from error
    except gym.error.Error as error:
        raise EnvironmentFaultError(
            f"env.id must be the id of an installed Gymnasium environment; got {environment_id!r} ({error})"
        ) from error


def describe(
    environment_id: str,
    features: tuple[str, ...] = (),
    units: tuple[str, ...] = (),
    actions: tuple[str, ...] = (),
    solved_at: float | None = None,
    max_episode_steps: int | None = None,
) -> EnvironmentSpec:
    """Describe a Gymnasium environment, with names for what it calls by number.

    Args:
        environment_id: Gymnasium id.
        features: [D] names; none means `x0, x1, ...`.
        units: [D] units; none means no units.
        actions: [A] names; none means `a0, a1, ...`.
        solved_at: Mean return from which the task is solved; None takes the environment's registered threshold.
        max_episode_steps: Episode limit; None takes the environment's own.

    Raises:
        EnvironmentFaultError: The environment is unknown, its spaces are not a flat Box and a Discrete, or the
            names do not fit them.
    """
    environment = make_gymnasium(environment_id, max_episode_steps)
    observation_space, action_space, registered = (
        environment.observation_space,
        environment.action_space,
        environment.spec,
    )
    environment.close()
    if not isinstance(observation_space, spaces.Box) or len(observation_space.shape) != 1:
        raise EnvironmentFaultError(
            f"{environment_id} must observe a flat Box, since a split compares one number; got {observation_space}"
        )
    if not isinstance(action_space, spaces.Discrete):
        raise EnvironmentFaultError(
            f"{environment_id} must have Discrete actions, since a leaf holds one of them; got {action_space}"
        )
    n_features, n_actions = observation_space.shape[0], int(action_space.n)
    _check_number("features", features, n_features, environment_id)
    _check_number("units", units, n_features, environment_id)
    _check_number("actions", actions, n_actions, environment_id)
    limit = registered.max_episode_steps if registered is not None else None
    threshold = registered.reward_threshold if registered is not None else None
    return EnvironmentSpec(
        id=environment_id,
        labels=TreeLabels(
            environment_id,
            features or tuple(f"x{i}" for i in range(n_features)),
            units or ("",) * n_features,
            actions or tuple(f"a{i}" for i in range(n_actions)),
        ),
        low=observation_space.low.astype(np.float32),
        high=observation_space.high.astype(np.float32),
        max_episode_steps=limit or UNBOUNDED_EPISODE_STEPS,
        has_limit=limit is not None,
        first_action=int(action_space.start),
        solved_at=threshold if solved_at is None else solved_at,
    )


def _check_number(what: str, names: tuple[str, ...], expected: int, environment_id: str) -> None:
    if names and len(names) != expected:
        raise EnvironmentFaultError(
            f"env.{what} must name the {expected} {what} of {environment_id}, or none; got {len(names)} names"
        )
