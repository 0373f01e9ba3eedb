"""PPO trains trees side by side as if each were alone (law 9)."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from ppo_for_tests import (
    ACTIONS,
    FEATURES,
    LITTLE,
    MIXED,
    GivenSource,
    Trained,
    assert_close,
    config,
    drawn_samples,
    drawn_trees,
    generators,
    hardened,
    leaf,
)
from strategies import trees
from tensordict import TensorDict

from ge_torchrl.refiners.rl.actor_critic import ValueNetworks, make_actor
from ge_torchrl.refiners.rl.advantages import ScanGAE
from ge_torchrl.refiners.rl.ddt import soften
from ge_torchrl.refiners.rl.ppo import Learner
from ge_torchrl.trees.tree import DecisionTree

small_thresholds = st.floats(-1, 1, width=32)


@settings(max_examples=10)
@given(
    st.lists(trees(FEATURES, thresholds=small_thresholds), min_size=2, max_size=4),
    st.sampled_from(
        [
            config(),
            config(optimizer="rmsprop", lr_actor=0.01),
            config(minibatch_size=64, epochs=1),
            config(standardise=True, max_timesteps=800),
            config(straight_through=True),
        ]
    ),
)
def test_trees_together_end_where_each_alone_would(forest, settings):
    """Law 9."""
    check_together_as_alone(forest, settings)


@settings(max_examples=12)
@given(
    st.integers(0, 10**6),
    st.sampled_from([0, 1, 2]),
    st.sampled_from([config(), config(standardise=True, max_timesteps=800), config(straight_through=True)]),
)
def test_trees_of_sums_and_of_values_end_together_where_each_alone_would(seed, n_values, settings):
    """Law 9; an axis-aligned tree stands beside the others."""
    beside = [leaf(1)] if n_values == 0 else [DecisionTree.value_leaf([0.3] * n_values)]
    check_together_as_alone([*drawn_trees(seed, n_values), *beside], settings)


def check_together_as_alone(forest, settings):
    together = Trained(forest, settings)
    for row, tree in enumerate(forest):
        alone = Trained([tree], settings, seeds=[row])
        assert_close(alone.parameters_of(0), together.parameters_of(row), 1e-4)
        ours, theirs = alone.records[0], together.records[row]
        assert (ours.gradient_steps, ours.updates, ours.timesteps) == (
            theirs.gradient_steps,
            theirs.updates,
            theirs.timesteps,
        )
        for name in ("actor_loss", "critic_loss", "entropy", "clip_fraction", "kl", "soft_return"):
            assert getattr(ours, name) == pytest.approx(getattr(theirs, name), abs=2e-3, nan_ok=True), name


def test_training_changes_numbers_and_not_structure():
    trained = Trained(MIXED, config(lr_actor=0.05))
    for tree, after in zip(MIXED, hardened(trained.ddt), strict=True):
        assert after.feature.tolist() == tree.feature.tolist()
        assert after.children_left.tolist() == tree.children_left.tolist()
    assert (trained.ddt.threshold[0] != 0).all()
    first = trained.records[0]
    assert (first.timesteps, first.updates, first.gradient_steps, first.failure) == (600, 3, 9, None)
    assert all(
        math.isfinite(getattr(first, name)) for name in ("actor_loss", "critic_loss", "kl", "soft_return")
    )
    assert 0 < first.entropy <= math.log(ACTIONS)
    assert 0 <= first.clip_fraction <= 1


def test_records_tell_of_the_policy_after_the_last_update():
    trained = Trained(MIXED, config(max_timesteps=200, update_timesteps=200, lr_actor=0.05))
    samples = torch.stack([drawn_samples(seed) for seed in range(3)])
    now = make_actor(trained.ddt).get_dist(samples)
    ratio = now.log_prob(samples["action"]) - samples["action_log_prob"]
    for row, record in enumerate(trained.records):
        assert record.kl == pytest.approx(-ratio[row].mean().item(), abs=1e-6)
        assert record.entropy == pytest.approx(now.entropy()[row].mean().item(), abs=1e-6)
        clipped = ((ratio[row].exp() - 1).abs() > LITTLE.clip_epsilon).float().mean().item()
        assert record.clip_fraction == pytest.approx(clipped, abs=1e-6)


def test_the_soft_return_is_the_mean_of_the_last_update_in_which_episodes_ended():
    def change(samples, batch):
        after = samples["next"]
        after["done"][:] = after["truncated"][:] = after["terminated"][:] = False
        after["episode_reward"][:] = 5.0
        if batch == 0:
            after["done"][0, [3, 9]] = after["truncated"][0, [3, 9]] = True
            after["episode_reward"][0, 3], after["episode_reward"][0, 9] = 10.0, 30.0

    first, second, _ = Trained(MIXED, change=change).records
    assert first.soft_return == 20.0
    assert math.isnan(second.soft_return)


def test_what_does_not_fill_an_update_is_not_taken():
    records = Trained(MIXED, config(max_timesteps=599)).records
    assert [(r.timesteps, r.updates) for r in records] == [(400, 2)] * 3


def test_lone_leaves_are_trained_too():
    trained = Trained([leaf(0), leaf(2)], config(lr_actor=0.1))
    assert trained.records[0].failure is None
    alone = Trained([leaf(2)], config(lr_actor=0.1), seeds=[1])
    assert_close(alone.parameters_of(0), trained.parameters_of(1), 1e-4)


def test_the_first_batch_measures_the_spreads_and_nothing_else():
    settings = config(standardise=True, max_timesteps=800)
    seen = []

    def change(samples, batch):
        if batch == 0:
            samples["observation"][:, :, 1] = 4.0
            samples["observation"][2, 0, 0] = torch.nan
            seen.append(samples["observation"].clone())

    trained = Trained(MIXED, settings, change=change)
    spread = seen[0][0].double().std(0)
    # The first tree asks for features 1, 0 and 1; what never moves, or is no number, has no scale of its own.
    np.testing.assert_allclose(trained.ddt.scale[0], [1.0, spread[0], 1.0], rtol=1e-5)
    np.testing.assert_allclose(trained.networks.feature_spread[0, :, 0], [spread[0], 1.0], rtol=1e-5)
    np.testing.assert_allclose(
        trained.networks.feature_mean[0, :, 0], [seen[0][0, :, 0].mean(), 4.0], rtol=1e-4
    )
    assert trained.networks.feature_spread[2, :, 0].tolist() == [1.0, 1.0]
    assert [(r.timesteps, r.updates, r.gradient_steps, r.failure) for r in trained.records] == [
        (800, 3, 9, None)
    ] * 3


def test_critics_standardise_values_by_their_first_targets():
    rngs = generators(range(3))
    ddt = soften(MIXED, ACTIONS, generators=rngs)
    networks = ValueNetworks(FEATURES, (8,), rngs)
    learner = Learner(ddt, make_actor(ddt), networks, LITTLE)
    samples = GivenSource(range(3)).collect(300)
    samples["next", "reward"] = samples["next", "reward"] * 50 - 100
    learner.standardise(samples.clone())
    with torch.no_grad():
        targets = ScanGAE(
            gamma=LITTLE.gamma, lmbda=LITTLE.gae_lambda, value_network=learner._loss.critic_network
        )(samples)
    assert (networks.value_mean < -50).all()
    assert (
        targets["value_target"].std(1).flatten() / networks.value_spread.flatten()
    ).tolist() == pytest.approx([1.0] * 3, rel=0.5)


def test_the_weight_of_entropy_falls_linearly():
    ddt = soften(MIXED, ACTIONS, leaf_sd=0)
    networks = ValueNetworks(FEATURES, (8,), generators(range(3)))
    learner = Learner(ddt, make_actor(ddt), networks, config(entropy_coeff=0.1, entropy_final=0.0))
    weights = []
    for progress in (0.0, 0.5, 1.0):
        learner.set_entropy_coeff(progress)
        weights.append(float(learner._loss.entropy_coeff))
    assert weights == pytest.approx([0.1, 0.05, 0.0])


def test_minibatches_use_every_sample_once_an_epoch():
    ddt = soften(MIXED, ACTIONS, leaf_sd=0)
    networks = ValueNetworks(FEATURES, (8,), generators(range(3)))
    learner = Learner(ddt, make_actor(ddt), networks, config(minibatch_size=150))
    number = torch.arange(500).expand(3, -1)
    batch = TensorDict({"number": number, "observation": number.unsqueeze(-1)}, [3, 500])
    first, second = (list(learner._minibatches(batch)) for _ in range(2))
    assert [part.shape for part in first] == [(3, 167), (3, 167), (3, 166)]
    assert torch.cat([part["number"][0] for part in first]).sort().values.tolist() == list(range(500))
    assert all(torch.equal(part["number"].unsqueeze(-1), part["observation"]) for part in first)
    assert not torch.equal(first[0]["number"], second[0]["number"])
    assert Trained(MIXED, config(minibatch_size=50)).records[0].gradient_steps == 3 * 3 * 4


def test_training_does_not_depend_on_torchs_threads_and_leaves_them_as_they_were():
    threads = torch.get_num_threads()
    results = []
    try:
        for n in (1, 2, 3):
            torch.set_num_threads(n)
            results.append(Trained(MIXED, config(max_timesteps=4000, update_timesteps=2000)))
            assert torch.get_num_threads() == n
    finally:
        torch.set_num_threads(threads)
    for other in results[1:]:
        assert other.records == results[0].records
        assert all(
            torch.equal(a, b)
            for a, b in zip(other.ddt.parameters(), results[0].ddt.parameters(), strict=True)
        )


def test_training_draws_nothing_from_the_global_stream():
    state = torch.get_rng_state()
    Trained(MIXED, config(minibatch_size=64))
    assert torch.equal(torch.get_rng_state(), state)


@pytest.mark.parametrize("dtype", [torch.float64, torch.int64])
def test_observations_of_any_type_are_trained_on(dtype):
    def whole(samples, _):
        samples["observation"] = (samples["observation"] * 3).round()
        samples["next", "observation"] = (samples["next", "observation"] * 3).round()

    def typed(samples, batch):
        whole(samples, batch)
        samples["observation"] = samples["observation"].to(dtype)
        samples["next", "observation"] = samples["next", "observation"].to(dtype)

    settings = config(standardise=True, max_timesteps=800)
    ours, theirs = (Trained(MIXED, settings, change=change) for change in (typed, whole))
    for row in range(3):
        assert_close(ours.parameters_of(row), theirs.parameters_of(row), 1e-6)
