"""Which wrapper makes an episode depend on those before it."""

import pytest
from environments_for_tests import UnseededEnv, register

from ge_torchrl.environments.carrying import carrying_wrappers
from ge_torchrl.environments.probing import obeys_seeds
from ge_torchrl.environments.spec import describe

FLAT = "gymnasium.wrappers:FlattenObservation"
MEAN = "gymnasium.wrappers:NormalizeObservation"
REWARD = "gymnasium.wrappers:NormalizeReward {gamma: 0.9}"
BINS = "gymnasium.wrappers:DiscretizeAction {bins: 3}"


@pytest.mark.parametrize(
    ("environment_id", "wrappers", "carrying"),
    [
        ("CartPole-v1", [MEAN], [MEAN]),
        ("Pendulum-v1", [BINS, MEAN, FLAT, REWARD], [MEAN, REWARD]),
        # Its observation is flat only with the first one.
        ("FrozenLake-v1", [FLAT, MEAN], [MEAN]),
        (register(UnseededEnv), [MEAN], []),
    ],
)
def test_who_carries_something_on_is_named(environment_id, wrappers, carrying):
    described = describe(environment_id, wrappers=wrappers)
    assert not obeys_seeds(described)
    assert carrying_wrappers(described) == tuple(carrying)


def test_of_wrappers_that_carry_nothing_none_is_named():
    described = describe("Pendulum-v1", wrappers=[BINS, FLAT])
    assert obeys_seeds(described)
    assert carrying_wrappers(described) == ()
