"""Law 5, episode by episode: kernel and Gymnasium tell one truth."""

import gymnasium as gym
import numpy as np
import pytest
from strategies import observed_trees
from trees_of_all_kinds import DISCRETE, PUBLISHED, all_kinds, oblique_trees

from ge_torchrl.environments.gymnasium_backend import GymnasiumBackend
from ge_torchrl.environments.kernel_backend import KernelBackend
from ge_torchrl.environments.spec import describe
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
# A step of Acrobot costs Gymnasium five of CartPole's.
TREES = {"CartPole-v1": 300, "MountainCar-v0": 300, "Acrobot-v1": 120}
# Unstable physics multiplies a last-bit difference of sine and cosine by thousands within an episode.
LEAST_EQUAL = {"MountainCar-v0": 1.0, "CartPole-v1": 0.99, "Acrobot-v1": 0.95}


@pytest.fixture
def both():
    """Open both backends of an environment."""
    backends = []

    def open_both(environment_id, **described):
        spec = describe(environment_id, **described)
        pair = KernelBackend(spec, 2), GymnasiumBackend(spec, workers=1)
        backends.extend(pair)
        return pair

    yield open_both
    for backend in backends:
        backend.close()


def evaluated(both, trees, seeds):
    forest = Forest.stack(trees)
    return [backend.evaluate(forest, seeds, "test", visits=True) for backend in both]


@pytest.mark.parametrize("environment_id", DISCRETE)
def test_random_trees_have_the_same_episodes(environment_id, both):
    trees = observed_trees(environment_id, TREES[environment_id], seed=1)
    ours, theirs = evaluated(both(environment_id), trees, np.array([11]))
    equal = (ours.returns == theirs.returns) & (ours.lengths == theirs.lengths)
    assert equal.mean() >= LEAST_EQUAL[environment_id]
    assert abs(ours.returns.mean() - theirs.returns.mean()) <= 0.01 * abs(theirs.returns.mean())
    # Trees that all act alike would make equality cheap.
    assert len(np.unique(theirs.returns)) > 5


@pytest.mark.parametrize("environment_id", DISCRETE)
def test_trees_of_weighted_sums_have_the_same_episodes(environment_id, both):
    trees = oblique_trees(environment_id, 60, seed=2)
    assert sum(not tree.is_axis_aligned for tree in trees) > 30
    ours, theirs = evaluated(both(environment_id), trees, np.array([12]))
    equal = (ours.returns == theirs.returns) & (ours.lengths == theirs.lengths)
    assert equal.mean() >= LEAST_EQUAL[environment_id]
    assert len(np.unique(theirs.returns)) > 2


@pytest.mark.parametrize("environment_id", DISCRETE)
def test_long_episodes_of_a_good_tree_are_nearly_all_equal(environment_id, both):
    ours, theirs = evaluated(both(environment_id), [PUBLISHED[environment_id][0]], np.arange(100))
    equal = ours.returns == theirs.returns
    assert equal.mean() >= LEAST_EQUAL[environment_id]
    # The few episodes that part ways are other draws from the same distribution.
    standard_error = theirs.returns.std() / np.sqrt(theirs.returns.size)
    assert abs(ours.returns.mean() - theirs.returns.mean()) <= 2 * standard_error


def test_leaves_are_visited_as_often(both):
    trees = all_kinds("MountainCar-v0")
    ours, theirs = evaluated(both("MountainCar-v0"), trees, np.arange(4))
    np.testing.assert_array_equal(ours.returns, theirs.returns)
    np.testing.assert_array_equal(ours.leaf_visits, theirs.leaf_visits)
    assert ours.leaf_visits.sum() == ours.env_steps


def plain_gymnasium(environment_id, tree, seed):
    """The oracle: one episode, as anybody would write it."""
    environment = gym.make(environment_id)
    observation, _ = environment.reset(seed=int(seed))
    observations, actions, rewards, ended = [observation], [], [], False
    while not ended:
        actions.append(int(tree.decide([observation])[0]))
        observation, reward, terminated, truncated, _ = environment.step(actions[-1])
        observations.append(observation)
        rewards.append(reward)
        ended = terminated or truncated
    return np.array(observations), np.array(actions), np.array(rewards), terminated, truncated


@pytest.mark.parametrize("environment_id", DISCRETE)
def test_a_recorded_episode_is_that_of_a_plain_loop(environment_id, both):
    # Early in an episode differences of a last bit are still small.
    tree = split(0, 0.01, leaf(0), leaf(1)) if environment_id == "CartPole-v1" else leaf(2)
    observations, actions, rewards, terminated, truncated = plain_gymnasium(environment_id, tree, 5)
    for backend in both(environment_id):
        played = backend.record(tree, 5)
        np.testing.assert_allclose(played.observations, observations, atol=1e-3)
        np.testing.assert_array_equal(played.observations[0], observations[0])
        np.testing.assert_array_equal(played.actions, actions)
        np.testing.assert_array_equal(played.rewards, rewards)
        assert (played.terminated, played.truncated) == (terminated, truncated)
        assert backend.steps == {"record": len(actions)}


@pytest.mark.parametrize("environment_id", DISCRETE)
def test_trees_observe_the_same_training_episodes(environment_id, both):
    trees = [PUBLISHED[environment_id][0], leaf(1), oblique_trees(environment_id, 9, seed=4)[3]]
    seen = [
        backend.observe(trees, 60, [np.random.default_rng(r) for r in range(3)], "neighbours")
        for backend in both(environment_id)
    ]
    np.testing.assert_allclose(seen[0], seen[1], atol=1e-4)


def test_exactly_at_a_threshold_a_tree_goes_right_when_observed_too(both):
    """Every episode of MountainCar begins at rest, where this tree pushes to the right."""
    for backend in both("MountainCar-v0"):
        tree = split(1, 0.0, leaf(0), leaf(2))
        observed = backend.observe([tree], 3000, [np.random.default_rng(3)], "neighbours")[0]
        at_rest = np.flatnonzero(observed[:-1, 1] == 0.0)
        assert len(at_rest) > 10
        pushed_right = 0.001 - 0.0025 * np.cos(3 * observed[at_rest, 0])
        np.testing.assert_allclose(observed[at_rest + 1, 1], pushed_right, atol=1e-6)


def test_an_episode_limit_of_the_user_truncates_on_both(both):
    ours, theirs = evaluated(both("MountainCar-v0", max_episode_steps=37), [leaf(1)], np.arange(5))
    assert (ours.returns == -37).all()
    assert (theirs.returns == -37).all()
