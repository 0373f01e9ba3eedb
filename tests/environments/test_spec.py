import gymnasium as gym
import numpy as np
import pytest
from environments_for_tests import (
    BoolWalkEnv,
    CountdownEnv,
    Float64WalkEnv,
    Int64WalkEnv,
    ThrustEnv,
    UInt8WalkEnv,
    register,
)

from ge_torchrl.environments.spec import UNBOUNDED_EPISODE_STEPS, describe, make_gymnasium
from ge_torchrl.errors import EnvironmentFaultError


@pytest.mark.parametrize(
    ("environment_id", "limit", "solved_at", "n_features", "n_actions"),
    [
        ("CartPole-v1", 500, 475.0, 4, 2),
        ("Acrobot-v1", 500, -100.0, 6, 3),
        ("MountainCar-v0", 200, -110.0, 2, 3),
        ("gymnasium:CartPole-v1", 500, 475.0, 4, 2),
    ],
)
def test_description_of_the_thesis_environments(environment_id, limit, solved_at, n_features, n_actions):
    described = describe(environment_id)
    assert described.id == described.names.id == environment_id
    assert described.max_episode_steps == limit
    assert described.has_limit
    assert described.names.max_episode_steps is None
    assert described.solved_at == solved_at
    assert (described.n_features, described.n_actions) == (n_features, n_actions)
    assert described.names.features == tuple(f"x{i}" for i in range(n_features))


def test_a_module_prefix_is_for_gym_make_and_works_with_box2d_too():
    pytest.importorskip("Box2D")
    described = describe("gymnasium:LunarLander-v3")
    assert (described.n_features, described.n_actions, described.solved_at) == (8, 4, 200)
    make_gymnasium(described).close()


def test_solved_means_reaching_the_threshold():
    described = describe("CartPole-v1")
    assert described.is_solved(475.0)
    assert not described.is_solved(474.99)
    assert not describe("CartPole-v1", solved_at=480).is_solved(475.0)
    assert not describe(register(CountdownEnv)).is_solved(1e9)


def test_wrong_number_of_names_is_refused_with_the_override():
    with pytest.raises(
        EnvironmentFaultError, match=r"env\.features must name the 4.*env\.features=\[\].*got 1"
    ):
        describe("CartPole-v1", features=("x",))
    with pytest.raises(EnvironmentFaultError, match=r"env\.actions must name the 2 actions.*got 3"):
        describe("CartPole-v1", actions=("x", "y", "z"))


@pytest.mark.parametrize(
    ("kind", "low", "high"),
    [
        (Float64WalkEnv, [-5, -5], [5, 5]),
        (Int64WalkEnv, [-5, -5], [5, 5]),
        (UInt8WalkEnv, [0, 0], [10, 10]),
        (BoolWalkEnv, [0, 0], [1, 1]),
    ],
)
def test_bounds_are_float32_whatever_the_type_observed(kind, low, high):
    described = describe(register(kind))
    assert described.low.dtype == described.high.dtype == np.float32
    assert (described.low.tolist(), described.high.tolist()) == (low, high)


@pytest.mark.parametrize(
    ("environment_id", "bounds"),
    [("Pendulum-v1", ((-2.0, 2.0),)), ("MountainCarContinuous-v0", ((-1.0, 1.0),))],
)
def test_continuous_actions_are_entries_with_bounds(environment_id, bounds):
    described = describe(environment_id)
    assert described.is_continuous
    assert described.names.action_bounds == bounds
    assert (described.names.actions, described.n_actions, described.first_action) == (("a0",), 1, 0)
    assert (described.action_low.dtype, described.action_high.dtype) == (np.float32, np.float32)
    assert (described.action_low.tolist(), described.action_high.tolist()) == ([bounds[0][0]], [bounds[0][1]])


def test_a_bound_of_an_action_beyond_float32_is_none():
    described = describe(register(ThrustEnv), actions=("main", "side"))
    assert described.names.actions == ("main", "side")
    assert described.names.action_bounds == ((0.0, float("inf")), (float("-inf"), 0.5))


def test_choices_have_no_bounds():
    described = describe("CartPole-v1")
    assert not described.is_continuous
    assert described.action_low.shape == described.action_high.shape == (0,)
    assert described.names.action_bounds == ()


def test_the_number_of_the_first_action_and_a_missing_limit_are_told():
    described = describe(register(CountdownEnv))
    assert (described.first_action, described.n_actions) == (5, 2)
    assert (described.has_limit, described.max_episode_steps) == (False, UNBOUNDED_EPISODE_STEPS)


def test_a_limit_of_the_user_is_kept_and_named():
    described = describe("MountainCar-v0", max_episode_steps=37)
    assert (described.max_episode_steps, described.names.max_episode_steps) == (37, 37)
    assert make_gymnasium(described).spec.max_episode_steps == 37


def test_a_wrapper_takes_arguments():
    wrapper = "gymnasium.wrappers:DiscretizeAction {bins: 5}"
    described = describe("Pendulum-v1", wrappers=(wrapper,))
    assert (described.n_actions, described.is_continuous) == (5, False)
    assert described.names.wrappers == (wrapper,)


@pytest.mark.parametrize("missing", ["action_space", "observation_space"])
@pytest.mark.parametrize("instead", [None, 2])
def test_an_environment_without_a_space_is_told_in_one_line(missing, instead):
    class Spaceless(gym.Env):
        observation_space = gym.spaces.Box(-1, 1, (2,))
        action_space = gym.spaces.Discrete(2)

    if instead is None:
        delattr(Spaceless, missing)
    else:
        setattr(Spaceless, missing, instead)
    Spaceless.__name__ += f"{missing}{instead}".replace("_", "")
    with pytest.raises(EnvironmentFaultError, match=rf"must have {missing}, a space of .*; got") as told:
        describe(register(Spaceless))
    assert "\n" not in str(told.value)
