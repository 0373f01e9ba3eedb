"""A declared mirror is held to the environment, by steps from mirrored states or by what policies and images return."""

import math
import re
import time

import gymnasium as gym
import numpy as np
import pytest
from environments_for_tests import TakingEnv, register

from ge_torchrl.environments import mirroring
from ge_torchrl.environments.mirroring import check_mirror, refuse_what_is_refuted, standard_errors_apart
from ge_torchrl.environments.settable import settable
from ge_torchrl.environments.spec import describe
from ge_torchrl.errors import ConfigError
from ge_torchrl.refiners.mirror import Mirror

CART = ("x", "x_dot", "theta", "theta_dot")
LANDER = ("x", "y", "x_dot", "y_dot", "theta", "theta_dot", "left_leg", "right_leg")
KNOWN = {
    "CartPole-v1": {"features": CART, "actions": ("left", "right")},
    "Acrobot-v1": {"features": ("c1", "s1", "c2", "s2", "w1", "w2"), "actions": ("minus", "none", "plus")},
    "MountainCar-v0": {"features": ("position", "velocity"), "actions": ("left", "none", "right")},
    "Pendulum-v1": {"features": ("cos", "sin", "w"), "actions": ("torque",)},
    "LunarLander-v3": {"features": LANDER, "actions": ("none", "left", "main", "right")},
    "LunarLanderContinuous-v3": {"features": LANDER, "actions": ("main", "side")},
}
LEFT_RIGHT = {"actions": {"left": "right"}}
LANDED = {"negate": ["x", "x_dot", "theta", "theta_dot"], "swap": [["left_leg", "right_leg"]]}


@pytest.fixture(autouse=True)
def forgetful(monkeypatch):
    monkeypatch.setattr(mirroring, "_verdicts", {})


def asked(environment_id, symmetry, **more):
    spec = describe(environment_id, **KNOWN.get(environment_id, {}), **more)
    return check_mirror(spec, symmetry, Mirror.declared(symmetry, spec.names))


@pytest.mark.parametrize(
    ("environment_id", "symmetry"),
    [
        ("CartPole-v1", {"negate": CART, **LEFT_RIGHT}),
        ("Acrobot-v1", {"negate": ["s1", "s2", "w1", "w2"], "actions": {"minus": "plus"}}),
        ("Pendulum-v1", {"negate": ["sin", "w"], "negate_actions": ["torque"]}),
    ],
)
def test_a_true_mirror_holds_step_by_step(environment_id, symmetry):
    verdict = asked(environment_id, symmetry)
    assert verdict.fault == ""
    assert "steps from mirrored states" in verdict.found
    refuse_what_is_refuted(verdict)


@pytest.mark.parametrize(
    ("environment_id", "symmetry"),
    [
        ("CartPole-v1", {"negate": CART}),
        ("CartPole-v1", LEFT_RIGHT),
        ("CartPole-v1", {"negate": CART[:3], **LEFT_RIGHT}),
        ("Acrobot-v1", {"negate": ["s1", "s2", "w1", "w2"]}),
        ("MountainCar-v0", {"negate": ["position", "velocity"], **LEFT_RIGHT}),
        ("MountainCar-v0", {"negate": ["velocity"], **LEFT_RIGHT}),
    ],
)
def test_a_false_one_is_refused_with_a_state_and_two_figures(environment_id, symmetry):
    verdict = asked(environment_id, symmetry)
    told = r"^env\.symmetry does not hold: in the mirror of \(\w+ = .*\) and action \w+, that is with action \w+, "
    told += r"\w+ has to become [-0-9.e]+ and becomes [-0-9.e]+; mend it, or type env\.symmetry=null"
    with pytest.raises(ConfigError, match=told) as raised:
        refuse_what_is_refuted(verdict)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("environment_id", "symmetry"),
    [
        ("LunarLander-v3", {**LANDED, **LEFT_RIGHT}),
        ("LunarLanderContinuous-v3", {**LANDED, "negate_actions": ["side"]}),
    ],
)
def test_where_states_cannot_be_set_policies_play_beside_their_images(environment_id, symmetry):
    pytest.importorskip("Box2D")
    verdict = asked(environment_id, symmetry)
    assert verdict.fault == ""
    assert re.fullmatch(r"\d+ random trees and their images saw .* alike, in 40 episodes each", verdict.found)


@pytest.mark.parametrize(
    ("environment_id", "symmetry"),
    [
        ("LunarLander-v3", LANDED),
        ("LunarLander-v3", LEFT_RIGHT),
        ("LunarLander-v3", {**LANDED, "actions": {"left": "main"}}),
        ("LunarLander-v3", {**LANDED, **LEFT_RIGHT, "negate": ["x", "x_dot", "theta"]}),
        ("LunarLanderContinuous-v3", LANDED),
    ],
)
def test_a_false_one_differs_by_many_standard_errors(environment_id, symmetry):
    pytest.importorskip("Box2D")
    with pytest.raises(ConfigError, match=r"a random tree .* and its image .* standard errors of"):
        refuse_what_is_refuted(asked(environment_id, symmetry))


def test_no_state_is_known_to_mirror_another_and_statistics_decide():
    """Negating the cosine is another angle, which no change of signs of the state gives."""
    verdict = asked("Pendulum-v1", {"negate": ["cos", "w"], "negate_actions": ["torque"]})
    assert "a random tree sees cos = " in verdict.fault


class TiltedEnv(gym.Env):
    """Slides on a line that is tilted by little; its state can be set, and is not all that it observes."""

    observation_space = gym.spaces.Box(-100, 100, (2,), np.float32)
    action_space = gym.spaces.Discrete(2)
    tilt = 1e-3
    pays = 0.0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed, options=options)
        self.state = self.np_random.uniform(-1, 1, 2)
        return self._get_obs(), {}

    def step(self, action):
        place, speed = self.state
        self.state = np.array([place + 0.1 * speed, speed + 0.1 * (2 * action - 1) + self.tilt])
        reward = 1 - abs(place) + self.pays * action
        return self._get_obs(), reward, bool(abs(place) > 3), False, {}

    def _get_obs(self):
        return np.float32([10 * self.state[0], self.state[1]])


class LevelEnv(TiltedEnv):
    """Not tilted."""

    tilt = 0.0


class PayingEnv(LevelEnv):
    """Pays a little more on one side."""

    pays = 1e-3


class NoisyEnv(TiltedEnv):
    """Has more in mind than its state."""

    def step(self, action):
        self.state[1] += self.np_random.normal()
        return super().step(action)


SLIDING = {"negate": ["x0", "x1"], "actions": {"a0": "a1"}}


def test_small_differences_are_found_where_states_are_set():
    assert asked(register(LevelEnv), SLIDING).fault == ""
    assert "x1 has to become" in asked(register(TiltedEnv), SLIDING).fault
    assert "the reward has to become" in asked(register(PayingEnv), SLIDING).fault


def test_a_state_that_is_not_all_is_none():
    assert settable(describe(register(NoisyEnv)), math.inf) is None
    wrapped = describe("CartPole-v1", wrappers=("gymnasium.wrappers:FlattenObservation",))
    assert settable(wrapped, math.inf) is None


def test_a_mirror_is_asked_once(monkeypatch):
    monkeypatch.setattr(mirroring, "settable", lambda *given, opened=[settable]: opened.pop()(*given))
    symmetry = {"negate": CART, **LEFT_RIGHT}
    assert asked("CartPole-v1", symmetry) is asked("CartPole-v1", symmetry)


def test_equal_returns_are_no_standard_error_apart_and_others_are():
    ones = np.ones(10)
    assert standard_errors_apart(ones, ones) == 0
    assert standard_errors_apart(ones, 2 * ones) > 1000
    assert standard_errors_apart(np.arange(10.0), np.arange(10.0) + 1) == pytest.approx(0.7385, abs=1e-3)


@pytest.mark.usefixtures("own_clock")
@pytest.mark.parametrize(
    ("taken", "is_tried", "found"),
    [
        (0.001, True, r"1 random trees and their images saw and returned alike, in \d\d episodes each"),
        (0.1, False, r".* steps too slowly"),
    ],
)
def test_of_a_slow_environment_a_mirror_is_tried_for_the_seconds_that_there_are(
    monkeypatch, taken, is_tried, found
):
    monkeypatch.setattr(TakingEnv, "seconds", taken)
    spec = describe(register(TakingEnv), features=("x", "odd"), actions=("left", "right"))
    symmetry = {"negate": ["x"], **LEFT_RIGHT}
    started = time.perf_counter()
    verdict = check_mirror(spec, symmetry, Mirror.declared(symmetry, spec.names), 10.0)
    assert time.perf_counter() - started < 11.0
    assert (verdict.is_tried, verdict.fault) == (is_tried, "")
    assert re.fullmatch(found, verdict.found)


@pytest.mark.usefixtures("own_clock")
def test_states_are_set_for_the_seconds_that_there_are():
    class SlowLevelEnv(LevelEnv):
        def step(self, action):
            time.sleep(0.1)
            return super().step(action)

    spec, started = describe(register(SlowLevelEnv)), time.perf_counter()
    verdict = check_mirror(spec, SLIDING, Mirror.declared(SLIDING, spec.names), 3.0)
    assert time.perf_counter() - started < 4.0
    assert re.fullmatch(r"\d\d? steps from mirrored states came out mirrored", verdict.found)
