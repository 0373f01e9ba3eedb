"""Making an environment of its id, arguments and wrappers; what cannot be made is told in one line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import yaml
from gymnasium.envs.registration import load_env_creator

from ge_torchrl.environments.plants.environment import register_plant
from ge_torchrl.environments.plants.plant import names_plant
from ge_torchrl.environments.registry import find_registered
from ge_torchrl.environments.suitable import one_line
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.printing import said_of

# What an environment raises is its fault, an attempt to end the program too; Ctrl-C is the user's.
FAULTS = (Exception, SystemExit)

# What `gym.make` gives: observations and actions are whatever the spaces say.
GymEnvironment = gym.Env[Any, Any]


_BOX2D = '; for Box2D environments: pip install -c constraints.txt -e ".[box2d]"'


def make(
    environment_id: str,
    max_episode_steps: int | None,
    kwargs: Mapping[str, Any],
    wrappers: Sequence[str],
    render_mode: str | None = None,
) -> GymEnvironment:
    """Make an environment.

    Args:
        environment_id: What `gym.make` takes, or a plant, `file.py:Class`.
        max_episode_steps: Episode limit; None takes the environment's own.
        kwargs: What else it is given.
        wrappers: Wrappers to put around it, innermost first, each written `module:Class`, or
            `module:Class {key: value}` with arguments.
        render_mode: As `gym.make` takes it.

    Raises:
        EnvironmentFaultError: It is unknown or cannot be made, with the reason and the remedy where one is known.
    """
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
    except gym.error.DeprecatedEnv as error:
        raise EnvironmentFaultError(f"env.id={environment_id}: {one_line(error)}") from error
    except (gym.error.Error, ImportError) as error:
        if isinstance(error, gym.error.DependencyNotInstalled) or environment_id in gym.registry:
            raise EnvironmentFaultError(
                f"env.id={environment_id} needs packages that are not installed ({one_line(error)})"
                + (_BOX2D if "box2d" in str(error).lower() else "")
            ) from error
        raise EnvironmentFaultError(
            f"env.id must be the id of an installed Gymnasium environment, as in env.id=CartPole-v1, with the module "
            f"that registers it in front unless that is Gymnasium itself, as in env.id=module:Name-v0; "
            f"got {environment_id!r} ({one_line(error)})"
        ) from error
    except FAULTS as error:
        with_kwargs = f" with env.kwargs={dict(kwargs)}" if kwargs else ""
        raise EnvironmentFaultError(
            f"env.id={environment_id} raised {said_of(error)} while it was made{with_kwargs}"
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
            f"env.wrappers: {wrapper} raised {said_of(error)} around {environment.unwrapped}"
        ) from error
    return wrapped


def _with_colon(name: str) -> str:
    """Return a wrapper's name with a colon in front of its class; one of Gymnasium's own may stand alone."""
    module, _, wrapper = name.replace(":", ".").rpartition(".")
    return f"{module or 'gymnasium.wrappers'}:{wrapper}"
