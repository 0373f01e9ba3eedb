"""The fused sampler draws from the soft tree's mixture, in the environment that Gymnasium steps."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from soft_trees_for_tests import calibration, mixture, soft_tree
from strategies import observed_trees

from ge_torchrl.environments.dynamics import DYNAMICS
from ge_torchrl.environments.soft_rollouts import Samples, SoftSampler
from ge_torchrl.environments.spec import describe
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.decision_tree import DecisionTree


def tree_of(environment_id, seed=5):
    return max(observed_trees(environment_id, 8, seed), key=lambda tree: tree.n_nodes)


# Steep enough to take sides, not so steep that the sides are all that counts.
ALPHAS = {"CartPole-v1": 20.0, "Acrobot-v1": 2.0, "MountainCar-v0": 50.0}


def sampler_and_tree(environment_id, *, seed=0, max_episode_steps=None):
    spec = describe(environment_id, max_episode_steps=max_episode_steps)
    tree = soft_tree(tree_of(environment_id), spec.n_actions, ALPHAS[environment_id], sharpness=3.0)
    return SoftSampler(spec, np.random.default_rng(seed)), tree


def mixtures(tree, observations):
    return np.array([mixture(tree, tree.probabilities, tree.alpha, x) for x in observations])


@pytest.mark.parametrize("environment_id", DYNAMICS)
def test_actions_are_drawn_from_the_mixture(environment_id):
    sampler, tree = sampler_and_tree(environment_id)
    samples = sampler.sample(tree, 20_000)
    assert calibration(samples.observations, samples.actions, mixtures(tree, samples.observations)) < 4
    blunter = tree._replace(alpha=tree.alpha / 3)
    assert calibration(samples.observations, samples.actions, mixtures(blunter, samples.observations)) > 6


@pytest.mark.parametrize("environment_id", DYNAMICS)
def test_episodes_are_gymnasiums(environment_id):
    sampler, tree = sampler_and_tree(environment_id, seed=3, max_episode_steps=12)
    samples = sampler.sample(tree, 240)
    seeds = iter(episode_seeds("training", 32, np.random.default_rng(3)))
    environment = gym.make(environment_id, max_episode_steps=12)
    ended, total = True, 0.0
    for t, action in enumerate(samples.actions):
        if ended:
            observation, _ = environment.reset(seed=int(next(seeds)))
            total, steps = 0.0, 0
        np.testing.assert_allclose(samples.observations[t], observation, atol=1e-5)
        observation, reward, terminated, truncated, _ = environment.step(int(action))
        total, steps, ended = total + reward, steps + 1, terminated or truncated
        np.testing.assert_allclose(samples.next_observations[t], observation, atol=1e-5)
        assert (samples.rewards[t], samples.terminated[t], samples.truncated[t]) == (
            reward,
            terminated,
            truncated,
        )
        assert (samples.episode_returns[t], samples.step_counts[t]) == (total, steps)
    assert samples.truncated.any()
    assert environment_id != "CartPole-v1" or samples.terminated.any()


@pytest.mark.parametrize("environment_id", DYNAMICS)
def test_how_calls_cut_the_stream_does_not_matter(environment_id):
    sampler, tree = sampler_and_tree(environment_id, max_episode_steps=30)
    whole = sampler.sample(tree, 2000)
    sampler, _ = sampler_and_tree(environment_id, max_episode_steps=30)
    parts = [sampler.sample(tree, n) for n in (1, 29, 900, 0, 1070)]
    for name in Samples._fields:
        joined = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(joined, getattr(whole, name))


def test_other_seeds_give_other_streams():
    sampler, tree = sampler_and_tree("CartPole-v1", seed=0)
    other, _ = sampler_and_tree("CartPole-v1", seed=1)
    assert (sampler.sample(tree, 100).actions != other.sample(tree, 100).actions).any()


def test_a_sharp_tree_acts_as_the_hard_one():
    tree = tree_of("CartPole-v1")
    spec = describe("CartPole-v1")
    sharp = soft_tree(tree, 2, alpha=1e9, sharpness=50.0)
    samples = SoftSampler(spec, np.random.default_rng(0)).sample(sharp, 5000)
    np.testing.assert_array_equal(samples.actions, tree.decide(samples.observations))


def test_a_lone_leaf_draws_by_its_probabilities():
    spec = describe("MountainCar-v0")
    leaf = soft_tree(DecisionTree.leaf(0), 3, alpha=1.0)._replace(probabilities=np.array([[0.2, 0.0, 0.8]]))
    actions = SoftSampler(spec, np.random.default_rng(0)).sample(leaf, 10_000).actions
    counts = np.bincount(actions, minlength=3)
    assert counts[1] == 0
    assert abs(counts[0] - 2000) < 4 * np.sqrt(10_000 * 0.16)


def test_an_environment_without_kernel_is_refused():
    spec = replace(describe("CartPole-v1"), id="Unheard-v0")
    with pytest.raises(EnvironmentFaultError, match="compiled dynamics"):
        SoftSampler(spec, np.random.default_rng(0))
