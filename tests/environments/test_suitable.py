"""Spaces that trees cannot live with, and that what is named helps."""

import re
from itertools import product

import gymnasium as gym
import numpy as np
import pytest
import yaml
from environments_for_tests import SpacesEnv
from gymnasium import spaces

from ge_torchrl.environments.border import Border
from ge_torchrl.environments.spec import describe
from ge_torchrl.environments.suitable import action_bounds, observed_box
from ge_torchrl.environments.witness import Witness
from ge_torchrl.environments.wrappers import FlatActions, OneChoice
from ge_torchrl.errors import EnvironmentFaultError

PLACE = spaces.Box(-1, 1, (2,), np.float32)


class SentenceSpace(spaces.Space):
    """Of a package of its own, such as MiniGrid: it has no flat form and does not say so."""

    def sample(self, mask=None, probability=None):  # noqa: ARG002
        return "go"

    def contains(self, x):
        return isinstance(x, str)


OBSERVED = {
    "Discrete": (spaces.Discrete(5), 5),
    "MultiDiscrete": (spaces.MultiDiscrete([2, 3]), 5),
    "MultiBinary": (spaces.MultiBinary(3), 3),
    "Box of no dimension": (spaces.Box(-1, 1, (), np.float32), 1),
    "matrix": (spaces.Box(-1, 1, (2, 3), np.float32), 6),
    "picture": (spaces.Box(0, 255, (4, 4, 3), np.uint8), 48),
    "Tuple": (spaces.Tuple([spaces.Discrete(3), PLACE]), 5),
    "Dict": (spaces.Dict({"agent": PLACE, "door": spaces.Discrete(2), "inner": spaces.Dict(at=PLACE)}), 6),
    "Dict with a sentence": (
        spaces.Dict({"at": PLACE, "mission": SentenceSpace(), "way": spaces.Discrete(3)}),
        5,
    ),
}
TAKEN = {
    "MultiDiscrete": (spaces.MultiDiscrete([2, 3]), 6),
    "MultiBinary": (spaces.MultiBinary(3), 8),
    "matrix": (spaces.Box(-1, 1, (2, 3), np.float32), 6),
    "number": (spaces.Box(-1, 1, (), np.float32), 1),
    "Dict": (spaces.Dict(a=PLACE, b=spaces.Box(0, 2, (1, 2), np.float64)), 4),
}


@pytest.fixture
def of_spaces():
    """Register an environment of given spaces; return its id."""

    def register(observed=None, taken=None):
        gym.register("OfSpaces-v0", entry_point=lambda: SpacesEnv(observed, taken))
        return "OfSpaces-v0"

    yield register
    gym.registry.pop("OfSpaces-v0", None)


def remedied(environment_id):
    """Do what a refusal says, and return the description that comes of it."""
    with pytest.raises(EnvironmentFaultError) as refused:
        describe(environment_id)
    assert "\n" not in str(refused.value)
    typed = re.search(r"env\.wrappers='(.*)'", str(refused.value))
    return describe(environment_id, wrappers=tuple(yaml.safe_load(typed[1])))


@pytest.mark.parametrize(("space", "n"), OBSERVED.values(), ids=OBSERVED)
def test_what_a_refusal_of_observations_names_helps(space, n, of_spaces):
    spec = remedied(of_spaces(observed=space))
    assert spec.n_features == n
    border = Border(spec, Witness(spec))
    assert len(border.reset(3)) == n
    assert border.step(1)[1] == 1.0


@pytest.mark.parametrize(("space", "n"), TAKEN.values(), ids=TAKEN)
def test_what_a_refusal_of_actions_names_helps(space, n, of_spaces):
    spec = remedied(of_spaces(taken=space))
    assert spec.n_actions == n
    environment = gym.make(spec.id, disable_env_checker=True)
    wrapped = (FlatActions if spec.is_continuous else OneChoice)(environment)
    wrapped.reset(seed=0)
    wrapped.action_space.seed(0)
    for _ in range(3):
        wrapped.step(wrapped.action_space.sample())
    assert len(environment.unwrapped.taken) == 3


def test_names_of_a_dict_are_its_keys(of_spaces):
    spec = remedied(of_spaces(observed=OBSERVED["Dict"][0]))
    assert spec.names.features == ("agent_0", "agent_1", "door_0", "door_1", "inner_at_0", "inner_at_1")


@pytest.mark.parametrize(
    ("space", "names"),
    [
        (spaces.Discrete(3, start=5), ("state_5", "state_6", "state_7")),
        (spaces.Tuple([spaces.Discrete(2), PLACE]), ("part0_0", "part0_1", "part1_0", "part1_1")),
        (spaces.Box(-1, 1, (2, 2), np.float32), ("x_0_0", "x_0_1", "x_1_0", "x_1_1")),
        (
            spaces.Dict(at=spaces.Box(-1, 1, (1, 2), np.float32), on=PLACE),
            ("at_0_0", "at_0_1", "on_0", "on_1"),
        ),
        (spaces.MultiBinary(2), ("x0", "x1")),
    ],
)
def test_what_is_flattened_is_named_by_its_place(space, names, of_spaces):
    assert remedied(of_spaces(observed=space)).names.features == names


def test_one_choice_is_every_combination():
    start = np.array([5, 0])
    environment = OneChoice(SpacesEnv(taken=spaces.MultiDiscrete([2, 3], start=start)))
    combinations = [environment.action(number).tolist() for number in range(environment.action_space.n)]
    assert combinations == [[5 + first, second] for first, second in product(range(2), range(3))]


def test_one_row_of_numbers_keeps_the_bounds_and_the_order(of_spaces):
    spec = remedied(of_spaces(taken=TAKEN["Dict"][0]))
    assert spec.names.action_bounds == ((-1.0, 1.0), (-1.0, 1.0), (0.0, 2.0), (0.0, 2.0))
    environment = FlatActions(SpacesEnv(taken=TAKEN["Dict"][0]))
    action = environment.action(np.array([0.1, 0.2, 0.3, 0.4], np.float32))
    assert action["a"].tolist() == pytest.approx([0.1, 0.2])
    assert action["b"].shape == (1, 2)


@pytest.mark.parametrize("kind", [OneChoice, FlatActions])
def test_our_wrappers_refuse_other_actions(kind):
    with pytest.raises(TypeError, match=f"{kind.__name__} takes"):
        kind(SpacesEnv(taken=spaces.Discrete(2)))


@pytest.mark.parametrize(
    "space", [spaces.Text(3), spaces.Sequence(spaces.Discrete(2)), spaces.Box(-1, 1, (0,), np.float32)]
)
def test_where_nothing_helps_a_wrapper_of_ones_own_does(space):
    with pytest.raises(EnvironmentFaultError, match=r"env\.wrappers='\["):
        observed_box(space, "Any-v0", ())
    with pytest.raises(
        EnvironmentFaultError, match=r"a wrapper of your own .*env\.wrappers='\[my_module:MyWrapper\]'"
    ):
        action_bounds(spaces.MultiBinary(40), "Any-v0", ())


def test_wrappers_that_are_there_stay_in_what_is_typed():
    there = ("my_module:A", "my_module:B {c: 3}")
    with pytest.raises(
        EnvironmentFaultError,
        match=re.escape(
            """env.wrappers='[my_module:A,"my_module:B {c: 3}",gymnasium.wrappers:FlattenObservation]'"""
        ),
    ):
        observed_box(spaces.Discrete(3), "Any-v0", there)


def test_an_atari_game_has_its_memory_too():
    with pytest.raises(EnvironmentFaultError, match=r"env\.kwargs\.obs_type=ram makes one of 128"):
        observed_box(spaces.Box(0, 255, (210, 160, 3), np.uint8), "ale_py:ALE/Pong-v5", ())
