"""What each setting of PPO beyond the thesis does to a step."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from ppo_for_tests import LEFT, RIGHT, SETTINGS, WRONG, are_equal, fused, generator, parameters_of, soft
from tensordict import TensorDict

from ge_torchrl.environments.spec import describe
from ge_torchrl.rl import ppo
from ge_torchrl.rl.actor_critic import make_actor_critic
from ge_torchrl.rl.ddt import harden, soften
from ge_torchrl.rl.ppo import PPOSettings, train
from ge_torchrl.rl.samples import open_source
from ge_torchrl.trees.decision_tree import DecisionTree

ONE_STEP = PPOSettings(1000, 500, 1, lr_actor=0.01, hidden=(8,), optimizer="adam")
ON_TWO_FEATURES = DecisionTree.split(2, 0.01, DecisionTree.split(3, 0.1, LEFT, RIGHT), RIGHT)


def moves_of(settings):
    """Return how far the thresholds of theta and theta_dot moved, and the tree."""
    ddt = soften(ON_TWO_FEATURES, 2, alpha=2.0, generator=generator())
    record = train(ddt, fused(), settings, seed=0)
    assert record.failure is None
    moves = np.abs(harden(ddt).threshold - ON_TWO_FEATURES.threshold)
    return moves[~ON_TWO_FEATURES.is_leaf], ddt


def test_adam_and_rmsprop_take_the_first_steps_that_their_papers_give():
    # Adam: lr * g / |g|. RMSprop: lr * g / sqrt((1 - 0.99) g**2).
    one_update = replace(ONE_STEP, max_timesteps=500)
    np.testing.assert_allclose(moves_of(one_update)[0], 0.01, rtol=1e-3)
    np.testing.assert_allclose(moves_of(replace(one_update, optimizer="rmsprop"))[0], 0.1, rtol=1e-3)


def test_with_scaled_features_a_step_is_a_share_of_the_features_spread():
    ddt = soften(ON_TWO_FEATURES, 2, alpha=2.0, generator=generator())
    actor, _ = make_actor_critic(ddt, 4, (8,), generator=generator())
    spread = fused().collect(actor, 500)["observation"].double().std(0).numpy()[[2, 3]]
    assert spread[1] > 5 * spread[0]
    moves, trained = moves_of(replace(ONE_STEP, scale_features=True))
    np.testing.assert_allclose(moves, 0.01 * spread, rtol=1e-3)
    np.testing.assert_allclose(trained.scale, spread, rtol=1e-6)


@pytest.mark.parametrize("changes", [{"scale_features": True}, {"scale_critic": True}])
def test_the_batch_that_measures_the_spreads_is_counted_and_not_trained_on(changes):
    record = train(soft(), fused(), replace(SETTINGS, **changes), seed=0)
    assert (record.timesteps, record.updates) == (1500, 2)


def test_a_critic_that_counts_in_spreads_does_not_have_to_learn_how_large_values_are():
    mountaincar = describe("MountainCar-v0")
    # Every value lies between -1 / (1 - gamma) = -50 and -1, and velocities within 0.07 of zero.
    settings = PPOSettings(3000, 1000, 5, gamma=0.98, gae_lambda=1.0, scale_critic=True)
    with_the_flow = DecisionTree.split(1, 0.0, LEFT, DecisionTree.leaf(2))

    def squared_error(**changes):
        ddt = soften(with_the_flow, 3, generator=generator())
        source = open_source(mountaincar, "fused", rng=np.random.default_rng(0))
        return train(ddt, source, replace(settings, **changes), seed=0).critic_loss

    # What is left of it is about the spread of the values; without it, about their size.
    assert squared_error() < 10**2
    assert squared_error(scale_critic=False) > 20**2


def test_a_feature_that_never_moves_keeps_its_scale():
    spread = ppo._spread(torch.tensor([[1.0, 5.0], [3.0, 5.0]]))
    assert spread.tolist() == pytest.approx([math.sqrt(2), 1.0])


def test_thresholds_have_a_learning_rate_of_their_own():
    slow, fast = (moves_of(replace(ONE_STEP, max_timesteps=500, lr_thresholds=lr)) for lr in (1e-4, 0.05))
    np.testing.assert_allclose(slow[0], 1e-4, rtol=1e-2)
    np.testing.assert_allclose(fast[0], 0.05, rtol=1e-3)
    assert torch.equal(slow[1].leaf_logits, fast[1].leaf_logits)


def test_steepness_is_annealed_geometrically():
    ddt, seen = soften(WRONG, 2, alpha=1.0, generator=generator()), []
    settings = replace(SETTINGS, alpha_final=100.0)
    train(ddt, fused(), settings, seed=0, after_update=lambda: seen.append(ddt.alpha))
    assert seen == pytest.approx([1.0, 10.0, 100.0])


def test_the_weight_of_entropy_falls_linearly():
    ddt = soft()
    settings = replace(SETTINGS, entropy_coeff=0.1, entropy_final=0.0)
    actor, critic = make_actor_critic(ddt, 4, (8,), generator=generator())
    learner = ppo._Learner(ddt, actor, critic, settings, generator())
    weights = []
    for progress in (0.0, 0.5, 1.0):
        learner.set_entropy_coeff(progress)
        weights.append(float(learner._loss.entropy_coeff))
    assert weights == pytest.approx([0.1, 0.05, 0.0])


def test_minibatches_use_every_sample_once_an_epoch():
    ddt = soft()
    actor, critic = make_actor_critic(ddt, 4, (8,), generator=generator())
    learner = ppo._Learner(ddt, actor, critic, replace(SETTINGS, minibatch_size=150), generator())
    batch = TensorDict({"number": torch.arange(500)}, [500])
    first, second = (learner._minibatches(batch) for _ in range(2))
    assert [len(part) for part in first] == [167, 167, 166]
    assert torch.cat([part["number"] for part in first]).sort().values.tolist() == list(range(500))
    assert not torch.equal(first[0]["number"], second[0]["number"])


def test_minibatches_are_more_steps_and_the_same_bits_again():
    settings = replace(SETTINGS, minibatch_size=100)
    (one, record), (two, again) = ((ddt, train(ddt, fused(), settings, seed=0)) for ddt in (soft(), soft()))
    assert record.gradient_steps == 3 * 5 * 5
    assert record == again
    assert are_equal(parameters_of(one), parameters_of(two))
