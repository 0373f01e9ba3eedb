"""The fused sampler draws from the soft trees' mixtures, in the environment that Gymnasium steps."""

import gymnasium as gym
import numpy as np
import pytest
from soft_forests_for_tests import calibration, hard_forest, mixtures, soft_forest
from strategies import observed_trees
from trees_of_all_kinds import DISCRETE

from ge_torchrl.environments.backend import Samples
from ge_torchrl.environments.kernel_backend import KernelBackend
from ge_torchrl.environments.spec import describe
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
# Steep enough to take sides, not so steep that the sides are all that counts.
ALPHAS = {"CartPole-v1": 20.0, "Acrobot-v1": 2.0, "MountainCar-v0": 50.0}
N_ACTIONS = {"CartPole-v1": 2, "Acrobot-v1": 3, "MountainCar-v0": 3}


def tree_of(environment_id, seed=5):
    return max(observed_trees(environment_id, 8, seed), key=lambda tree: tree.num_decision_nodes)


def generators(n, seed=0):
    return [np.random.default_rng([seed, stream]) for stream in range(n)]


@pytest.fixture
def sampled():
    """Sample soft trees: one stream each, in parts of the steps given."""
    backends = []

    def sample(environment_id, soft, *parts, rngs, threads=1, max_episode_steps=None):
        spec = describe(environment_id, max_episode_steps=max_episode_steps)
        backends.append(KernelBackend(spec, threads))
        sampler = backends[-1].sampler(rngs)
        samples = [sampler.sample(soft, n, "sampling") for n in parts]
        assert backends[-1].steps == {"sampling": len(rngs) * sum(parts)}
        return Samples(*(np.concatenate(column, axis=1) for column in zip(*samples, strict=True)))

    yield sample
    for backend in backends:
        backend.close()


@pytest.mark.parametrize("environment_id", DISCRETE)
def test_actions_are_drawn_from_the_mixture(environment_id, sampled):
    trees = [tree_of(environment_id), leaf(1), tree_of(environment_id, seed=6)]
    soft = soft_forest(trees, N_ACTIONS[environment_id], ALPHAS[environment_id], sharpness=3.0)
    samples = sampled(environment_id, soft, 20_000, rngs=generators(3))
    blunter = soft._replace(alpha=soft.alpha / 3)
    of_blunter = []
    for r in range(3):
        seen, chosen = samples.observations[r], samples.actions[r]
        assert calibration(seen, chosen, mixtures(soft, r, seen)) < 4.5
        of_blunter.append(calibration(seen, chosen, mixtures(blunter, r, seen)))
    assert max(of_blunter) > 6, "a wrong steepness would be noticed"


@pytest.mark.parametrize("environment_id", DISCRETE)
def test_episodes_are_gymnasiums(environment_id, sampled):
    soft = soft_forest(
        [tree_of(environment_id)] * 2, N_ACTIONS[environment_id], ALPHAS[environment_id], sharpness=3.0
    )
    samples = sampled(environment_id, soft, 240, rngs=generators(2), max_episode_steps=12)
    environment = gym.make(environment_id, max_episode_steps=12)
    for r, rng in enumerate(generators(2)):
        rng.integers(2**62)  # The seed of the stream's decisions comes first.
        seeds = iter(np.concatenate([episode_seeds("training", 32, rng) for _ in range(2)]))
        ended, total = True, 0.0
        for t, action in enumerate(samples.actions[r]):
            if ended:
                observation, _ = environment.reset(seed=int(next(seeds)))
                total = 0.0
            np.testing.assert_allclose(samples.observations[r, t], observation, atol=1e-5)
            observation, reward, terminated, truncated, _ = environment.step(int(action))
            total, ended = total + reward, terminated or truncated
            np.testing.assert_allclose(samples.next_observations[r, t], observation, atol=1e-5)
            flags = samples.terminated[r, t], samples.truncated[r, t]
            # Gymnasium's limit counts whether or not the task ended the episode in the same step.
            assert (samples.rewards[r, t], *flags) == (reward, terminated, truncated)
            assert samples.episode_returns[r, t] == total
    assert samples.truncated.any()
    assert environment_id != "CartPole-v1" or samples.terminated.any()


def assert_equal(some, others):
    for name in Samples._fields:
        np.testing.assert_array_equal(getattr(some, name), getattr(others, name), err_msg=name)


@pytest.mark.parametrize("environment_id", DISCRETE)
def test_how_calls_cut_the_streams_does_not_matter(environment_id, sampled):
    soft = soft_forest(
        observed_trees(environment_id, 3, seed=5), N_ACTIONS[environment_id], ALPHAS[environment_id]
    )
    whole = sampled(environment_id, soft, 2000, rngs=generators(3), max_episode_steps=30)
    parts = (1, 29, 900, 0, 1070)
    assert_equal(sampled(environment_id, soft, *parts, rngs=generators(3), max_episode_steps=30), whole)


@pytest.mark.parametrize("environment_id", DISCRETE)
def test_a_stream_is_the_same_alone_and_beside_others_on_any_number_of_threads(environment_id, sampled):
    """Nineteen streams are several groups; lone leaves and larger trees stand side by side, padded."""
    trees = [*observed_trees(environment_id, 18, seed=7), leaf(0)]
    soft = soft_forest(trees, N_ACTIONS[environment_id], ALPHAS[environment_id])
    together = sampled(environment_id, soft, 400, rngs=generators(19), max_episode_steps=50)
    for threads in (2, 3):
        again = sampled(environment_id, soft, 400, rngs=generators(19), threads=threads, max_episode_steps=50)
        assert_equal(again, together)
    for r in (0, 9, 18):
        lone = soft_forest([trees[r]], N_ACTIONS[environment_id], ALPHAS[environment_id])
        alone = sampled(environment_id, lone, 400, rngs=generators(19)[r : r + 1], max_episode_steps=50)
        assert_equal(alone, Samples(*(column[r : r + 1] for column in together)))


def test_other_seeds_give_other_streams(sampled):
    soft = soft_forest([tree_of("CartPole-v1")] * 2, 2, 20.0)
    samples = sampled("CartPole-v1", soft, 100, rngs=generators(2))
    assert (samples.actions[0] != samples.actions[1]).any()


@pytest.mark.parametrize("environment_id", DISCRETE)
def test_an_infinitely_steep_tree_is_the_hard_one(environment_id, sampled):
    trees = observed_trees(environment_id, 6, seed=8)
    samples = sampled(environment_id, hard_forest(trees, N_ACTIONS[environment_id]), 3000, rngs=generators(6))
    for r, tree in enumerate(trees):
        np.testing.assert_array_equal(samples.actions[r], tree.decide(samples.observations[r]))


def test_exactly_at_a_threshold_an_infinitely_steep_tree_goes_right(sampled):
    """Every episode of MountainCar begins at rest, where this tree pushes to the right."""
    hard = hard_forest([split(1, 0.0, leaf(0), leaf(2))], 3)
    samples = sampled("MountainCar-v0", hard, 2000, rngs=generators(1))
    at_rest = samples.observations[0, :, 1] == 0.0
    assert at_rest.sum() >= 10
    assert (samples.actions[0, at_rest] == 2).all()


def test_a_lone_leaf_draws_by_its_probabilities(sampled):
    soft = soft_forest([leaf(0)], 3, alpha=1.0)._replace(probabilities=np.array([[[0.2, 0.0, 0.8]]]))
    actions = sampled("MountainCar-v0", soft, 10_000, rngs=generators(1)).actions
    counts = np.bincount(actions[0], minlength=3)
    assert counts[1] == 0
    assert abs(counts[0] - 2000) < 4 * np.sqrt(10_000 * 0.16)


@pytest.mark.parametrize("bad", [0, 1, ~2])
def test_children_that_lead_astray_are_refused(bad, sampled):
    soft = soft_forest([split(0, 0.0, leaf(0), leaf(1))], 2, 1.0)
    with pytest.raises(ValueError, match="behind its parent"):
        sampled(
            "CartPole-v1", soft._replace(children_left=np.full((1, 1), bad, np.int32)), 5, rngs=generators(1)
        )
    with pytest.raises(ValueError, match="2 streams need as many soft trees; got 1"):
        sampled("CartPole-v1", soft, 5, rngs=generators(2))
