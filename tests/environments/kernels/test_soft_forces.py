"""The fused sampler draws values from mixtures of normal distributions, and gives them clipped to the environment."""

import gymnasium as gym
import numpy as np
import pytest
from continuous_trees import CONTINUOUS, force_trees
from soft_forces_for_tests import means_of_leaves, soft_forces
from soft_forests_for_tests import calibration, mixtures

from ge_torchrl.environments.backend import Samples
from ge_torchrl.environments.kernel_backend import KernelBackend
from ge_torchrl.environments.spec import describe
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.tree import DecisionTree

leaf = DecisionTree.value_leaf


def generators(n, seed=0):
    return [np.random.default_rng([seed, stream]) for stream in range(n)]


def trees_of(environment_id, n, seed=5):
    return [tree for tree in force_trees(environment_id, 4 * n, seed) if tree.num_decision_nodes >= 2][:n]


@pytest.fixture
def sampled():
    """Sample soft trees: one stream each, in parts of the steps given."""
    backends = []

    def sample(environment_id, soft, *parts, rngs, threads=1, max_episode_steps=None):
        backends.append(KernelBackend(describe(environment_id, max_episode_steps=max_episode_steps), threads))
        sampler = backends[-1].sampler(rngs)
        samples = [sampler.sample(soft, n, "sampling") for n in parts]
        return Samples(*(np.concatenate(column, axis=1) for column in zip(*samples, strict=True)))

    yield sample
    for backend in backends:
        backend.close()


def n_features(environment_id):
    return describe(environment_id).n_features


@pytest.mark.parametrize("environment_id", CONTINUOUS)
def test_leaves_are_drawn_by_their_paths(environment_id, sampled):
    """Values lie so close around those of their leaf that they tell which it was."""
    trees = trees_of(environment_id, 3)
    soft = soft_forces(trees, n_features(environment_id), alpha=1.5, sd=1e-4)
    n_leaves = soft.mean.shape[1]
    soft.mean[:] += 100.0 * np.arange(n_leaves)[:, np.newaxis]
    samples = sampled(environment_id, soft, 10_000, rngs=generators(3))
    for r in range(3):
        seen = samples.observations[r]
        distances = abs(samples.actions[r][:, np.newaxis, 0] - means_of_leaves(soft, r, seen)[..., 0])
        drawn = distances.argmin(1)
        assert distances.min(1).max() < 1e-2
        by_leaf = soft._replace(probabilities=np.tile(np.eye(n_leaves), (3, 1, 1)))
        assert calibration(seen, drawn, mixtures(by_leaf, r, seen)) < 4.5
        steeper = by_leaf._replace(alpha=3 * soft.alpha)
        assert calibration(seen, drawn, mixtures(steeper, r, seen)) > 6, "a wrong steepness would be noticed"


@pytest.mark.parametrize("environment_id", CONTINUOUS)
def test_values_are_normal_around_their_leafs_sum_and_never_clipped(environment_id, sampled):
    slopes = {feature: [0.7 * (-1) ** feature] for feature in range(n_features(environment_id))}
    soft = soft_forces([leaf([0.4], slopes)], n_features(environment_id), alpha=1.0, sd=1.3)
    samples = sampled(environment_id, soft, 40_000, rngs=generators(1))
    seen = samples.observations[0]
    z = (samples.actions[0, :, 0] - means_of_leaves(soft, 0, seen)[:, 0, 0]) / 1.3
    n = len(z)
    assert abs(z.mean()) < 4 / np.sqrt(n)
    assert abs((z**2).mean() - 1) < 4 * np.sqrt(2 / n)
    assert abs(z[:-1] @ z[1:]) / n < 4 / np.sqrt(n)
    spread = np.maximum(seen.std(0), 1e-9)
    assert (abs(((seen - seen.mean(0)) / spread * z[:, np.newaxis]).mean(0)) < 4 / np.sqrt(n)).all()
    assert abs(samples.actions).max() > 3.0, "beyond the bounds of both environments"


@pytest.mark.parametrize("environment_id", CONTINUOUS)
def test_episodes_are_those_that_gymnasium_plays_with_the_clipped_values(environment_id, sampled):
    soft = soft_forces(trees_of(environment_id, 2), n_features(environment_id), alpha=2.0, sd=0.6)
    samples = sampled(environment_id, soft, 240, rngs=generators(2), max_episode_steps=12)
    environment = gym.make(environment_id, max_episode_steps=12)
    low, high = environment.action_space.low, environment.action_space.high
    clipped = np.clip(samples.actions, low, high)
    assert 0.1 < (clipped != samples.actions).mean() < 0.95
    for r, rng in enumerate(generators(2)):
        rng.integers(2**62)  # The seed of the stream's decisions comes first.
        seeds = iter(np.concatenate([episode_seeds("training", 32, rng) for _ in range(2)]))
        ended, total = True, 0.0
        for t, action in enumerate(clipped[r]):
            if ended:
                observation, _ = environment.reset(seed=int(next(seeds)))
                total = 0.0
            np.testing.assert_allclose(samples.observations[r, t], observation, atol=1e-5)
            observation, reward, terminated, truncated, _ = environment.step(action)
            total, ended = total + reward, terminated or truncated
            np.testing.assert_allclose(samples.next_observations[r, t], observation, atol=1e-5)
            assert (samples.terminated[r, t], samples.truncated[r, t]) == (terminated, truncated)
            assert samples.rewards[r, t] == pytest.approx(reward, rel=1e-5, abs=1e-6)
            assert samples.episode_returns[r, t] == pytest.approx(total, rel=1e-5, abs=1e-6)
    assert samples.truncated.any()


@pytest.mark.parametrize("environment_id", CONTINUOUS)
def test_an_infinitely_steep_tree_without_noise_is_the_hard_one(environment_id, sampled):
    """Their leaves have one term at most: the order of a sum is that of features here, and of terms there."""
    trees = [
        DecisionTree.weighted_split([0, 1], [1.0, 0.3], -0.2, leaf([-0.5], {1: [2.0]}), leaf([5.0])),
        leaf([0.1], {0: [3.0]}),
    ]
    soft = soft_forces(trees, n_features(environment_id), alpha=np.inf, sd=0.0)
    samples = sampled(environment_id, soft, 3000, rngs=generators(2))
    for r, tree in enumerate(trees):
        np.testing.assert_array_equal(samples.actions[r], tree.decide(samples.observations[r]))


def assert_equal(some, others):
    for name in Samples._fields:
        np.testing.assert_array_equal(getattr(some, name), getattr(others, name), err_msg=name)


@pytest.mark.parametrize("environment_id", CONTINUOUS)
def test_a_stream_depends_on_its_generator_and_its_tree_alone(environment_id, sampled):
    """Nineteen streams are several groups; lone leaves and larger trees stand side by side, padded."""
    trees, width = force_trees(environment_id, 19, seed=7), n_features(environment_id)
    soft = soft_forces(trees, width, alpha=2.0, sd=0.5)
    together = sampled(environment_id, soft, 400, rngs=generators(19), max_episode_steps=50)
    again = sampled(environment_id, soft, 1, 99, 0, 300, rngs=generators(19), threads=2, max_episode_steps=50)
    assert_equal(again, together)
    for r in (0, 9, 18):
        lone = soft_forces([trees[r]], width, alpha=2.0, sd=0.5)
        alone = sampled(environment_id, lone, 400, rngs=generators(19)[r : r + 1], max_episode_steps=50)
        assert_equal(alone, Samples(*(column[r : r + 1] for column in together)))


def test_leaves_that_do_not_draw_the_environments_actions_are_refused(sampled):
    soft = soft_forces([leaf([0.0, 1.0])], 3, alpha=1.0, sd=1.0)
    with pytest.raises(
        ValueError, match=r"a mean for each entry .* Pendulum-v1, \[1, 1, 1\]; got \[1, 1, 2\]"
    ):
        sampled("Pendulum-v1", soft, 5, rngs=generators(1))
    with pytest.raises(ValueError, match=r"a probability for each action of CartPole-v1"):
        sampled("CartPole-v1", soft, 5, rngs=generators(1))
