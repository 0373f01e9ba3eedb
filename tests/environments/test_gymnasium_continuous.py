"""Trees with values act in environments of Box actions as anybody would let them."""

import gymnasium as gym
import numpy as np
import pytest
from environments_for_tests import EchoEnv, Float64EchoEnv, ThrustEnv, register
from faulty_environments import LateNaNThrustEnv
from hypothesis import given
from hypothesis import strategies as st
from strategies import value_trees

from ge_torchrl.environments.gymnasium_backend import GymnasiumBackend
from ge_torchrl.environments.spec import describe
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

value_leaf, split = DecisionTree.value_leaf, DecisionTree.split

TREES = {
    "Pendulum-v1": [
        split(0, 0.7, value_leaf([0.3], {2: [1.5], 1: [-8.0]}), value_leaf([0.0], {1: [-9.0], 2: [-2.0]})),
        value_leaf([0.7]),
    ],
    "MountainCarContinuous-v0": [split(1, 0.0, value_leaf([-1.2]), value_leaf([0.9]))],
    "LunarLanderContinuous-v3": [
        split(
            3,
            -0.2,
            value_leaf([0.6, 0.0], {4: [0.0, 2.0], 5: [0.1, 1.0]}),
            value_leaf([-1.0, 0.0], {4: [0.0, 2.0]}),
        )
    ],
}


def plain_loop(environment_id, tree, seed):
    """The oracle: one episode, as anybody would write it."""
    environment = gym.make(environment_id)
    space = environment.action_space
    observation, _ = environment.reset(seed=seed)
    total, length, ended = 0.0, 0, False
    while not ended:
        action = np.clip(tree.decide(observation[np.newaxis])[0], space.low, space.high).astype(space.dtype)
        observation, reward, terminated, truncated, _ = environment.step(action)
        total, length, ended = total + float(reward), length + 1, terminated or truncated
    return total, length


@pytest.mark.parametrize("environment_id", TREES)
def test_it_is_a_plain_gymnasium_loop(open_gymnasium, environment_id):
    if environment_id.startswith("LunarLander"):
        pytest.importorskip("Box2D")
    trees = TREES[environment_id]
    forest, seeds = Forest.stack(trees), np.arange(3)
    outcomes = open_gymnasium(describe(environment_id)).evaluate(forest, seeds, "fitness", visits=True)
    for p, tree in enumerate(trees):
        for e in range(3):
            expected = plain_loop(environment_id, tree, e)
            assert (outcomes.returns[p, e], outcomes.lengths[p, e]) == expected
    assert outcomes.leaf_visits.sum() == outcomes.env_steps
    assert (outcomes.leaf_visits > 0).all()


@pytest.fixture(scope="module")
def echoes():
    backends = [GymnasiumBackend(describe(register(kind)), workers=1) for kind in (EchoEnv, Float64EchoEnv)]
    yield backends
    for backend in backends:
        backend.close()


@given(value_trees(4, 2), st.integers(0, 1000), st.sampled_from([0, 1]))
def test_it_does_what_the_tree_answers_cut_to_the_bounds(echoes, tree, seed, which):
    """Law 4, and the environment may keep and change what it is given."""
    backend = echoes[which]
    played = backend.record(tree, seed)
    answers = tree.decide(played.observations[:-1])
    largest = np.finfo(np.float32).max
    low, high = (
        np.clip(bound, -largest, largest) for bound in (backend.spec.action_low, backend.spec.action_high)
    )
    expected = np.clip(answers, low, high)
    assert played.actions.dtype == np.float32
    np.testing.assert_array_equal(played.actions, expected)
    np.testing.assert_array_equal(backend._runner.border._environment.unwrapped.given, expected)


def test_processes_change_nothing(open_gymnasium):
    described = describe("MountainCarContinuous-v0", max_episode_steps=50)
    alone, together = open_gymnasium(described, workers=1), open_gymnasium(described, workers=2)
    trees = [*TREES["MountainCarContinuous-v0"], value_leaf([0.1], {1: [-3.0]}), value_leaf([1.0])]
    outcomes = [
        backend.evaluate(Forest.stack(trees), np.arange(6), "fitness", visits=True)
        for backend in (alone, together)
    ]
    for ours, theirs in zip(*(vars(each).values() for each in outcomes), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    rngs = [[np.random.default_rng(r) for r in range(4)] for _ in range(2)]
    four = [trees[i] for i in (0, 1, 2, 0)]
    seen = [
        backend.observe(four, 90, own, "refinement")
        for backend, own in zip((alone, together), rngs, strict=True)
    ]
    np.testing.assert_array_equal(*seen)


def test_an_entry_without_a_bound_takes_any_number(open_gymnasium):
    backend = open_gymnasium(ThrustEnv)
    assert backend.evaluate(Forest.stack([value_leaf([1e6, -1e6])]), np.arange(1), "fitness").returns == 0
    assert backend.record(value_leaf([-3.0, 3.0]), 0).actions.tolist() == [[0.0, 0.5]] * 3


def test_a_fault_names_the_entries_of_the_action(open_gymnasium):
    backend = open_gymnasium(LateNaNThrustEnv)
    with pytest.raises(
        EnvironmentFaultError, match=r"episode seed 9999, step 1, action a0 = 2\.5, a1 = 0\.5$"
    ):
        backend.record(value_leaf([2.5, 7.0]), 9999)
