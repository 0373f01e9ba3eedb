import gymnasium as gym
import numpy as np
import pytest
from environments_for_tests import (
    ContinuousEnv,
    CountdownEnv,
    EndlessEnv,
    NaNEnv,
    NaNRewardEnv,
    PicturesEnv,
    RaisingEnv,
)

from ge_torchrl.environments import gymnasium_route, spec
from ge_torchrl.environments.choose import agrees_with_gymnasium, open_route
from ge_torchrl.environments.compiled_route import CompiledRoute
from ge_torchrl.environments.dynamics import DYNAMICS
from ge_torchrl.environments.gymnasium_route import GymnasiumRoute
from ge_torchrl.environments.spec import describe
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest


@pytest.fixture
def register():
    ids = []

    def register(kind):
        environment_id = f"Test{kind.__name__}-v0"
        gym.register(environment_id, entry_point=kind)
        ids.append(environment_id)
        return environment_id

    yield register
    for environment_id in ids:
        del gym.registry[environment_id]


@pytest.mark.parametrize(
    ("environment_id", "limit", "solved_at", "n_features", "n_actions"),
    [
        ("CartPole-v1", 500, 475.0, 4, 2),
        ("Acrobot-v1", 500, -100.0, 6, 3),
        ("MountainCar-v0", 200, -110.0, 2, 3),
    ],
)
def test_description_of_the_thesis_environments(environment_id, limit, solved_at, n_features, n_actions):
    described = describe(environment_id)
    assert described.max_episode_steps == limit
    assert described.solved_at == solved_at
    assert (described.n_features, described.n_actions) == (n_features, n_actions)
    assert described.labels.features == tuple(f"x{i}" for i in range(n_features))


def test_solved_means_reaching_the_threshold():
    described = describe("CartPole-v1")
    assert described.is_solved(475.0)
    assert not described.is_solved(474.99)
    assert not describe("CartPole-v1", solved_at=480).is_solved(475.0)


def test_unknown_environment_is_named():
    with pytest.raises(EnvironmentFaultError, match=r"env\.id.*'NoSuchThing-v0'"):
        describe("NoSuchThing-v0")


def test_wrong_number_of_names_is_refused():
    with pytest.raises(EnvironmentFaultError, match=r"env\.features must name the 4 features.*got 1"):
        describe("CartPole-v1", features=("x",))


@pytest.mark.parametrize(("kind", "expected"), [(PicturesEnv, "flat Box"), (ContinuousEnv, "Discrete")])
def test_unsuitable_spaces_are_refused(register, kind, expected):
    with pytest.raises(EnvironmentFaultError, match=expected):
        describe(register(kind))


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        (
            RaisingEnv,
            r"RaisingEnv-v0 raised RuntimeError\('the motor is on fire'\); episode seed 3, step 2, action 1 \(a1\)",
        ),
        (NaNEnv, r"NaNEnv-v0 returned an observation with NaN.*episode seed 3, step 1, action 1 \(a1\)"),
        (NaNRewardEnv, r"returned a reward that is not a number; episode seed 3, step 0, action 1"),
    ],
)
def test_faults_are_reported_with_id_seed_step_and_action(register, kind, expected):
    route = GymnasiumRoute(describe(register(kind)), workers=1)
    with pytest.raises(EnvironmentFaultError, match=expected):
        route.evaluate(Forest.stack([DecisionTree.leaf(1)]), np.array([3]))
    route.close()


def test_an_endless_episode_is_a_fault(register, monkeypatch):
    monkeypatch.setattr(spec, "UNBOUNDED_EPISODE_STEPS", 50)
    route = GymnasiumRoute(describe(register(EndlessEnv)), workers=1)
    with pytest.raises(EnvironmentFaultError, match="did not end an episode within 50 steps"):
        route.evaluate(Forest.stack([DecisionTree.leaf(0)]), np.array([0]))
    route.close()


def test_an_endless_environment_with_a_limit_is_truncated(register):
    described = describe(register(EndlessEnv), max_episode_steps=20)
    route = GymnasiumRoute(described, workers=1)
    assert route.evaluate(Forest.stack([DecisionTree.leaf(0)]), np.array([0])).lengths.tolist() == [[20]]
    route.close()


@pytest.mark.parametrize("environment_id", DYNAMICS)
def test_auto_takes_the_compiled_route_where_it_agrees(environment_id):
    assert agrees_with_gymnasium(describe(environment_id))
    route = open_route(describe(environment_id))
    assert isinstance(route, CompiledRoute)
    route.close()


def test_auto_falls_back_with_a_warning_where_gymnasium_differs(monkeypatch, caplog):
    gravity_on_the_moon = gym.make("CartPole-v1")
    gravity_on_the_moon.unwrapped.gravity = 1.62
    monkeypatch.setattr("ge_torchrl.environments.choose.make_gymnasium", lambda _: gravity_on_the_moon)
    route = open_route(describe("CartPole-v1"))
    assert isinstance(route, gymnasium_route.GymnasiumRoute)
    assert "differs from the compiled dynamics" in caplog.text
    route.close()


def test_compiled_route_is_refused_where_there_is_none(register):
    with pytest.raises(EnvironmentFaultError, match=r"env\.route=compiled needs compiled dynamics"):
        open_route(describe(register(CountdownEnv)), "compiled")
