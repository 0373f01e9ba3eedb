"""An environment is made as it is asked for, or what is wrong is told in one line."""

from importlib.metadata import EntryPoint

import gymnasium as gym
import pytest
from environments_for_tests import DoubledReward

from ge_torchrl.environments.spec import describe, make_gymnasium
from ge_torchrl.errors import EnvironmentFaultError


@pytest.mark.parametrize(
    "environment_id", ["NoSuchThing-v0", "no_such_module:Thing-v0", "CartPole-v77", "a b"]
)
def test_unknown_environment_is_named(environment_id):
    with pytest.raises(EnvironmentFaultError, match=rf"env\.id.*'{environment_id}'") as caught:
        describe(environment_id)
    assert "\n" not in str(caught.value)


def test_a_known_environment_without_its_packages_is_told_what_is_missing(monkeypatch):
    def of_no_module(**_):
        raise ModuleNotFoundError("No module named 'drawing'")

    monkeypatch.setitem(
        gym.registry, "Bare-v0", gym.envs.registration.EnvSpec("Bare-v0", entry_point=of_no_module)
    )
    with pytest.raises(EnvironmentFaultError) as caught:
        describe("Bare-v0")
    told = "env.id=Bare-v0 needs packages that are not installed (No module named 'drawing')"
    assert str(caught.value) == told


def test_arguments_and_wrappers_are_kept():
    described = describe(
        "MountainCar-v0", kwargs={"goal_velocity": 0.01}, wrappers=("environments_for_tests:DoubledReward",)
    )
    environment = make_gymnasium(described)
    assert isinstance(environment, gym.Wrapper)
    assert type(environment).__name__ == DoubledReward.__name__
    assert environment.unwrapped.goal_velocity == 0.01
    assert described.names.kwargs == {"goal_velocity": 0.01}
    assert described.names.wrappers == ("environments_for_tests:DoubledReward",)


@pytest.mark.parametrize(
    ("wrapper", "said"),
    [
        ("FlattenObservation", r"must be names such as gymnasium\.wrappers:FlattenObservation"),
        ("gymnasium.wrappers:FlatenObservation", r"must be names such as .*FlatenObservation"),
        ("no_such_module:Wrapper", "must be names such as .*No module named"),
        ("gymnasium.wrappers:ClipReward {low: ", "must be names such as"),
        ("gymnasium.wrappers:ClipReward 3", "must be names such as"),
        ("os:system", r"must be subclasses of gymnasium\.Wrapper; got os:system"),
        ("gymnasium.wrappers:DiscretizeAction", "raised TypeError.*bins"),
    ],
)
def test_a_wrapper_that_is_none_is_refused_in_one_line(wrapper, said):
    with pytest.raises(
        EnvironmentFaultError, match=rf"env\.wrappers:? .*{said}|env\.wrappers {said}"
    ) as caught:
        describe("Pendulum-v1", wrappers=(wrapper,))
    assert "\n" not in str(caught.value)


def test_an_unknown_id_is_told_of_the_module_that_registers_it():
    with pytest.raises(
        EnvironmentFaultError, match=r"the module that registers it in front .*env.id=module:Name-v0"
    ):
        describe("FlappyBird-v77")


def test_a_package_may_register_its_environments_by_an_entry_point(monkeypatch):
    """As MinAtar does; Gymnasium 1 does not call it."""
    asked = []

    def declared(group):
        asked.append(group)
        return [
            EntryPoint("other", "another_package:no_function", group),
            EntryPoint("ours", "environments_for_tests:register_plugin", group),
        ]

    monkeypatch.setattr("ge_torchrl.environments.registry.entry_points", declared)
    try:
        assert describe("environments_for_tests:Plugged/Walk-v0").n_features == 2
        assert describe("environments_for_tests:Plugged/Walk-v0").n_actions == 2
    finally:
        del gym.registry["Plugged/Walk-v0"]
    assert asked == ["gymnasium.envs"], "it is called where the module alone did not register the environment"


def test_what_an_environment_raises_while_it_is_made_is_one_line():
    with pytest.raises(
        EnvironmentFaultError,
        match=r"env\.id=CartPole-v1 raised TypeError.*was made with env\.kwargs=.*wheels",
    ):
        describe("CartPole-v1", kwargs={"wheels": 3})


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("gymnasium.wrappers.DiscretizeAction", "gymnasium.wrappers:DiscretizeAction"),
        ("gymnasium:wrappers:DiscretizeAction", "gymnasium.wrappers:DiscretizeAction"),
        ("FlattenObservation", "gymnasium.wrappers:FlattenObservation"),
    ],
)
def test_a_wrapper_without_its_colon_is_told_with_it(typed, meant):
    with pytest.raises(EnvironmentFaultError, match=rf"one colon.*type env\.wrappers='\[{meant}\]'"):
        describe("CartPole-v1", wrappers=(typed,))


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("CartPole", "CartPole-v1"),
        ("gymnasium:CartPole", "gymnasium:CartPole-v1"),
        ("Taxi-v1", r"Taxi-v\d+"),
        ("LunarLander-v2", "LunarLander-v3"),
    ],
)
def test_an_id_of_no_version_or_of_one_that_is_gone_is_told_with_the_newest(typed, meant, recwarn):
    with pytest.raises(EnvironmentFaultError, match=rf"env\.id={typed} .*; type env\.id={meant}$"):
        describe(typed)
    assert not recwarn.list
