"""Names that follow from wrappers: actions that were cut into bins."""

import re

import gymnasium as gym
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from plants_for_tests import write_plants

from ge_torchrl.environments.naming import action_names
from ge_torchrl.environments.spec import describe

BINS = "gymnasium.wrappers:DiscretizeAction"
ONE_CHOICE = "ge_torchrl.environments.wrappers:OneChoice"
PENDULUM = ("action_minus_1_6", "action_minus_0_8", "action_0", "action_0_8", "action_1_6")


@pytest.mark.parametrize(
    ("environment", "wrappers", "names"),
    [
        ("Pendulum-v1", [f"{BINS} {{bins: 5}}"], PENDULUM),
        ("Pendulum-v1", [f"{BINS} {{bins: 5, multidiscrete: true}}", ONE_CHOICE], PENDULUM),
        ("Pendulum-v1", [f"{BINS} {{bins: 3}}"], ("action_minus_1_33", "action_0", "action_1_33")),
        ("Pendulum-v1", [f"{BINS} {{bins: 1}}"], ("action_0",)),
        ("{plants}:Box", [f"{BINS} {{bins: 3}}"], ("force_minus_0_97", "force_minus_0_3", "force_0_37")),
        ("{plants}:Two", [f"{BINS} {{bins: [1, 2]}}"], ("along_0_across_0_5", "along_0_across_1_5")),
        # A force between -1 and 1 is none.
        (
            "{plants}:Box",
            ["gymnasium.wrappers:RescaleAction {min_action: -1, max_action: 1}", f"{BINS} {{bins: 2}}"],
            ("action_minus_0_5", "action_0_5"),
        ),
        # What this makes of an action nobody knows.
        (
            "Pendulum-v1",
            [f"{BINS} {{bins: 2}}", "gymnasium.wrappers:StickyAction {repeat_action_probability: 0.5}"],
            ("a0", "a1"),
        ),
    ],
)
def test_bins_of_a_continuous_action_are_named_by_their_values(tmp_path, environment, wrappers, names):
    described = describe(environment.format(plants=write_plants(tmp_path)), wrappers=wrappers)
    assert described.names.actions == names
    assert described.names.action_bounds == ()


@given(
    bounds=st.tuples(st.floats(-1e6, 1e6, width=32), st.floats(-1e6, 1e6, width=32)).map(sorted),
    bins=st.integers(1, 40),
)
def test_the_name_of_a_bin_is_a_word_that_reads_as_its_value(bounds, bins):
    low, high = bounds
    # What is too near to each other for names has numbers.
    assume(high - low > max(1e-6, 1e-3 * max(abs(low), abs(high))))
    environment = gym.make("Pendulum-v1").unwrapped
    environment.action_space = gym.spaces.Box(low, high, (1,))
    cut = gym.wrappers.DiscretizeAction(environment, bins)
    names = action_names(cut, bins)
    assert len(set(names)) == bins
    for action, name in enumerate(names):
        word = re.fullmatch(r"action_(minus_)?([0-9]+)(?:_([0-9]+))?", name)
        value = float(f"{'-' if word[1] else ''}{word[2]}.{word[3] or 0}")
        assert abs(value - float(cut.action(action)[0])) <= 0.011 * (high - low) / bins
