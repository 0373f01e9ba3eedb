"""PPO trains trees side by side as if each were alone (law 9), and never leaves one in ruins."""

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

small_thresholds = st.floats(-1, 1, width=32)


def spoiled(key, value, *, tree=1, batch=1):
    """Put a value into one sample of one tree."""

    def change(samples, number):
        if number == batch:
            samples[key][tree, 7] = value

    return change


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


def naive_parameters(tree, seed, settings):
    """One tree trained by formulas written out: no stack, no padding, no TorchRL."""
    rngs = generators([seed])
    start = soften([tree], ACTIONS, settings.alpha, leaf_logit=settings.leaf_logit, generators=rngs)
    networks = ValueNetworks(FEATURES, settings.critic_hidden, rngs)
    moves = torch.zeros(tree.num_decision_nodes, requires_grad=True)
    logits = start.leaf_logits[0].detach().clone().requires_grad_()
    layers = [
        (weight[0].detach().clone().requires_grad_(), bias[0, :, 0].detach().clone().requires_grad_())
        for weight, bias in networks.layers()
    ]
    optimizer = torch.optim.Adam(
        [
            {"params": [moves, logits], "lr": settings.lr_actor},
            {"params": [p for layer in layers for p in layer], "lr": settings.lr_critic},
        ]
    )
    threshold = torch.from_numpy(tree.threshold.copy())

    def probabilities(node, x):
        if node < 0:
            return logits[~node].softmax(0)
        z = settings.alpha * (threshold[node] + moves[node] - x[tree.feature[node]])
        left, right = (probabilities(int(c[node]), x) for c in (tree.children_left, tree.children_right))
        return torch.sigmoid(z) * left + torch.sigmoid(-z) * right

    def value(x):
        for i, (weight, bias) in enumerate(layers):
            x = torch.nn.functional.linear(x if i == 0 else x.relu(), weight, bias)
        return x.squeeze(-1)

    for batch in range(settings.max_timesteps // settings.update_timesteps):
        samples = drawn_samples(1000 * batch + seed, settings.update_timesteps)
        seen, then = samples["observation"], samples["next", "observation"]
        reward, done, terminated = (
            samples["next", key].squeeze(-1).double() for key in ("reward", "done", "terminated")
        )
        with torch.no_grad():
            now, later = value(seen).double(), value(then).double()
        delta = reward + settings.gamma * (1 - terminated) * later - now
        advantage = torch.zeros_like(delta)
        for t in range(len(delta) - 1, -1, -1):
            beyond = advantage[t + 1] if t + 1 < len(delta) else 0.0
            advantage[t] = delta[t] + settings.gamma * settings.gae_lambda * (1 - done[t]) * beyond
        target = (advantage + now).float()
        normal = ((advantage - advantage.mean()) / advantage.std()).float()
        progress = batch / max(settings.max_timesteps // settings.update_timesteps - 1, 1)
        bonus = settings.entropy_coeff * (1 - progress)
        for _ in range(settings.epochs):
            p = torch.stack([probabilities(0 if len(moves) else ~0, x) for x in seen])
            chosen = p.gather(1, samples["action"].unsqueeze(1)).squeeze(1)
            ratio = chosen / samples["action_log_prob"].exp()
            clipped = ratio.clamp(1 - settings.clip_epsilon, 1 + settings.clip_epsilon)
            gain = torch.minimum(ratio * normal, clipped * normal).mean()
            entropy = -(p * p.log()).sum(1).mean()
            error = 0.5 * (value(seen) - target).square().mean()
            optimizer.zero_grad()
            (-gain - bonus * entropy + error).backward()
            optimizer.step()
    numbers = {"threshold": moves, "leaf_logits": logits[: tree.num_leaves]}
    numbers["numbers"] = torch.cat([p.flatten() for layer in layers for p in layer])
    return {name: number.detach() for name, number in numbers.items()}


def test_training_is_that_of_formulas_written_out():
    settings = config(max_timesteps=120, update_timesteps=40, epochs=2)
    trained = Trained(MIXED, settings)
    for row, tree in enumerate(MIXED):
        assert_close(naive_parameters(tree, row, settings), trained.parameters_of(row), 1e-4)


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


FAILURES = {
    "an observation": spoiled("observation", torch.nan),
    "a reward": spoiled(("next", "reward"), torch.inf),
    "the loss": spoiled("action_log_prob", torch.nan),
}


@pytest.mark.parametrize("what", FAILURES)
@pytest.mark.parametrize("optimizer", ["adam", "rmsprop"])
def test_a_failing_tree_is_put_back_and_disturbs_no_other(what, optimizer):
    """Law 9; it fails in the second update, when it and its optimiser have moved already."""
    settings, steps = config(optimizer=optimizer), 3
    trained = Trained(MIXED, settings, change=FAILURES[what])
    before = Trained(MIXED, config(max_timesteps=200, epochs=1, lr_actor=1e-12, lr_critic=1e-12))
    failures = [record.failure for record in trained.records]
    assert failures == [None, f"{what} is not finite in update 2, after {steps} gradient steps", None]
    assert trained.records[1].gradient_steps == steps
    assert_close(trained.parameters_of(1), before.parameters_of(1), 1e-9)
    for row in (0, 2):
        alone = Trained([MIXED[row]], settings, seeds=[row])
        assert_close(trained.parameters_of(row), alone.parameters_of(0), 1e-4)
        assert trained.records[row].gradient_steps == 9


def test_a_gradient_and_a_parameter_that_are_not_finite_put_a_tree_back_too():
    def learner():
        rngs = generators(range(3))
        ddt = soften(MIXED, ACTIONS, LITTLE.alpha, generators=rngs)
        return ddt, Learner(ddt, make_actor(ddt), ValueNetworks(FEATURES, (8,), rngs), config(epochs=1))

    def spoiled_gradient(gradient):
        gradient = gradient.clone()
        gradient[1] = torch.inf
        return gradient

    ddt, of_gradient = learner()
    hook = ddt.threshold.register_hook(spoiled_gradient)
    of_gradient.update(GivenSource(range(3)).collect(50))
    hook.remove()
    assert [r.failure for r in of_gradient.records()] == [
        None,
        "a gradient is not finite in update 1, after 0 gradient steps",
        None,
    ]
    ddt, of_parameter = learner()
    of_parameter._optimizer.register_step_post_hook(lambda *_: ddt.threshold.data[0].fill_(torch.nan))
    of_parameter.update(GivenSource(range(3)).collect(50))
    assert (
        of_parameter.records()[0].failure == "a parameter is not finite in update 1, after 0 gradient steps"
    )
    assert of_parameter.alive.tolist() == [False, True, True]
    assert hardened(ddt)[0] == MIXED[0]


def test_training_ends_when_all_trees_have_failed():
    looks = []

    def change(samples, batch):
        if batch == 1:
            samples["next", "reward"][:] = torch.nan

    trained = Trained(MIXED, change=change, after_update=lambda: looks.append(1))
    assert len(looks) == 1
    assert {record.updates for record in trained.records} == {1}
    assert [record.timesteps for record in trained.records] == [400] * 3
    assert hardened(trained.ddt) == list(MIXED)


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
