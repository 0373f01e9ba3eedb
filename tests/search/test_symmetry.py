"""A mirror that the environment does not have is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import yaml
from mirrors_for_tests import MIRRORS, NAMES
from problems_for_tests import cartpole, problem_of

from ge_torchrl.config.sections import EnvironmentConfig
from ge_torchrl.environments.spec import describe_settings
from ge_torchrl.errors import ConfigError
from ge_torchrl.refiners.mirror import Mirror
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.symmetry import MIRROR, check_mirror, standard_errors_apart

CONF = Path(__file__).resolve().parents[2] / "conf" / "env"


def checked(mirror):
    backend = cartpole()
    try:
        check_mirror(replace(problem_of(backend), mirror=mirror))
        return backend.steps[MIRROR]
    finally:
        backend.close()


@pytest.fixture
def sums(monkeypatch):
    monkeypatch.setattr(Problem, "is_oblique", True)


@pytest.mark.usefixtures("sums")
def test_the_mirror_of_cartpole_is_believed():
    assert checked(MIRRORS["cart"]) > 0


@pytest.mark.usefixtures("sums")
@pytest.mark.parametrize(
    "symmetry", [{"actions": {"left": "right"}}, {"negate": ["x", "x_dot", "theta", "theta_dot"]}]
)
def test_half_a_mirror_is_refuted_with_figures(symmetry):
    with pytest.raises(ConfigError, match=r"env.symmetry is refuted: a tree returns .* type '~env.symmetry'"):
        checked(Mirror.declared(symmetry, NAMES["cart"]))


def test_what_nothing_uses_is_not_asked():
    assert checked(Mirror.declared({"actions": {"left": "right"}}, NAMES["cart"])) == 0


def test_equal_returns_are_no_standard_error_apart_and_others_are():
    ones = np.ones(10)
    assert standard_errors_apart(ones, ones) == 0
    assert standard_errors_apart(ones, 2 * ones) > 1000
    assert standard_errors_apart(np.arange(10.0), np.arange(10.0) + 1) == pytest.approx(0.7385, abs=1e-3)


# How far entries of the state go; in the mirror of these environments all of them change their sign.
SHIPPED = {"cartpole": (0.2, 4), "acrobot": (3.0, 4), "pendulum": (3.0, 2)}


@pytest.mark.parametrize("name", sorted(SHIPPED))
def test_shipped_mirrors_hold_step_by_step_where_states_can_be_set(name):
    far, n_entries = SHIPPED[name]
    settings = yaml.safe_load((CONF / f"{name}.yaml").read_text())["env"]
    spec = describe_settings(EnvironmentConfig(**settings))
    mirror, rng = Mirror.declared(settings["symmetry"], spec.names), np.random.default_rng(0)
    one, other = (gymnasium.make(spec.id) for _ in range(2))
    for _ in range(50):
        state = rng.uniform(-far, far, n_entries)
        for env, its_state in ((one, state), (other, -state)):
            env.reset(seed=0)
            env.unwrapped.state = its_state
        action = one.action_space.sample()
        if spec.is_continuous:
            image = mirror.action_sign.astype(np.float32) * action[mirror.action]
        else:
            image = int(mirror.action[action])
        seen, reward, ended, *_ = one.step(action)
        expected, same, as_well, *_ = other.step(image)
        np.testing.assert_allclose(mirror.observations(seen), expected, atol=1e-5)
        assert (reward, ended) == (pytest.approx(same, abs=1e-5), as_well)
