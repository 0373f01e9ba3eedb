"""PPO trains trees, treats truncation as such, and never leaves a tree in ruins."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from ppo_for_tests import (
    CARTPOLE,
    LEFT,
    SETTINGS,
    WRONG,
    are_equal,
    fused,
    generator,
    parameters_of,
    soft,
)
from tensordict import TensorDict

from ge_torchrl.environments.compiled_route import CompiledRoute
from ge_torchrl.rl import ppo
from ge_torchrl.rl.actor_critic import make_actor_critic
from ge_torchrl.rl.ddt import harden
from ge_torchrl.rl.ppo import PPOSettings, TrainingRecord, make_advantages, train
from ge_torchrl.rl.samples import open_source
from ge_torchrl.trees.forest import Forest


def samples_of(n_steps, *, ends_every, by_truncation):
    """Return samples of constant reward 1 whose episodes end every so many steps."""
    done = (torch.arange(1, n_steps + 1) % ends_every == 0).unsqueeze(-1)
    no = torch.zeros_like(done)
    after = {
        "observation": torch.ones(n_steps, 4),
        "reward": torch.ones(n_steps, 1),
        "episode_reward": torch.ones(n_steps, 1),
        "done": done,
        "truncated": done if by_truncation else no,
        "terminated": no if by_truncation else done,
    }
    before = {
        "observation": torch.ones(n_steps, 4),
        "action": torch.zeros(n_steps, dtype=torch.int64),
        "action_log_prob": torch.full((n_steps,), math.log(0.5)),
    }
    return TensorDict({**before, "next": TensorDict(after, [n_steps])}, [n_steps])


def constant_critic(value):
    _, critic = make_actor_critic(soft(), 4, (8,), generator=generator())
    with torch.no_grad():
        for parameter in critic.parameters():
            parameter.zero_()
        list(critic.parameters())[-1].fill_(value)
    return critic


class ChangedSource:
    """Gives the samples of CartPole, changed from the second batch on."""

    spec = CARTPOLE

    def __init__(self, change):
        self.change, self.source, self.batches = change, fused(), 0

    def collect(self, actor, n_frames):
        samples = self.source.collect(actor, n_frames)
        self.batches += 1
        if self.batches > 1:
            self.change(samples)
        return samples

    def close(self):
        self.source.close()


@pytest.mark.parametrize("gamma", [0.5, 0.95])
def test_a_truncated_episode_bootstraps_and_a_terminated_one_does_not(gamma):
    value = 1 / (1 - gamma)
    advantages = make_advantages(constant_critic(value), gamma, 0.9)
    truncated = advantages(samples_of(12, ends_every=4, by_truncation=True))["advantage"].squeeze(-1)
    torch.testing.assert_close(truncated, torch.zeros(12), atol=1e-4, rtol=0)
    terminated = advantages(samples_of(12, ends_every=4, by_truncation=False))["advantage"].squeeze(-1)
    # The last delta is 1 - V, those before are 0: it decays backwards, and stops where an episode began.
    decay = (gamma * 0.9) ** torch.tensor([3.0, 2.0, 1.0, 0.0])
    torch.testing.assert_close(terminated, ((1 - value) * decay).repeat(3), atol=1e-4, rtol=0)


def test_advantages_typed_by_hand():
    samples = samples_of(3, ends_every=3, by_truncation=False)
    samples["next", "reward"] = torch.tensor([[1.0], [2.0], [3.0]])
    result = make_advantages(constant_critic(10.0), 0.5, 0.5)(samples)
    # delta = 1 + 5 - 10, 2 + 5 - 10, 3 - 10; each advantage adds a quarter of the next one.
    np.testing.assert_allclose(result["advantage"].squeeze(-1), [-5.1875, -4.75, -7.0], rtol=1e-6)
    np.testing.assert_allclose(result["value_target"].squeeze(-1), [4.8125, 5.25, 3.0], rtol=1e-6)


@pytest.mark.parametrize(("by_truncation", "expected"), [(True, 2.0), (False, 1.0)])
def test_a_critic_learns_the_value_beyond_a_truncation(by_truncation, expected):
    settings = PPOSettings(4000, 40, 5, gamma=0.5, lr_critic=0.003, hidden=(16,))
    ddt = soft()
    actor, critic = make_actor_critic(ddt, 4, settings.hidden, generator=generator())
    learner = ppo._Learner(ddt, actor, critic, settings, generator())
    record = TrainingRecord()
    for _ in range(100):
        record = learner.update(samples_of(40, ends_every=1, by_truncation=by_truncation), record)
    assert record.failure is None
    with torch.no_grad():
        assert critic.module(torch.ones(4)).item() == pytest.approx(expected, abs=0.1)


def test_training_mends_wrong_leaves():
    ddt = soft()
    settings = PPOSettings(20_000, 1000, 15, lr_actor=0.003, lr_critic=0.003)
    record = train(ddt, fused(), settings, seed=1)
    route = CompiledRoute(CARTPOLE, threads=1)
    outcomes = route.evaluate(Forest.stack([WRONG, harden(ddt)]), np.arange(20))
    before, after = outcomes.returns.mean(1)
    assert before < 12
    assert after > 80
    assert (record.timesteps, record.updates, record.gradient_steps) == (20_000, 20, 300)
    assert record.failure is None
    assert record.soft_return > 40
    assert 0 < record.entropy < math.log(2)
    assert 0 <= record.clip_fraction < 1
    assert all(math.isfinite(value) for value in (record.actor_loss, record.critic_loss, record.kl))


def test_the_structure_and_features_stay():
    ddt = soft()
    train(ddt, fused(), SETTINGS, seed=0)
    trained = harden(ddt)
    assert trained.feature.tolist() == WRONG.feature.tolist()
    assert trained.children_left.tolist() == WRONG.children_left.tolist()
    assert trained.threshold[0] != WRONG.threshold[0]


@pytest.mark.parametrize("source", ["fused", "collector"])
def test_one_seed_gives_the_same_bits_and_the_global_stream_is_untouched(source):
    def trained(seed):
        ddt = soft()
        opened = open_source(CARTPOLE, source, rng=np.random.default_rng(seed))
        settings = PPOSettings(400, 200, 3, hidden=(8,))
        record = train(ddt, opened, settings, seed=seed)
        opened.close()
        return parameters_of(ddt), record

    state = torch.get_rng_state()
    (first, record), (same, same_record), (other, _) = trained(1), trained(1), trained(2)
    assert torch.equal(torch.get_rng_state(), state)
    assert are_equal(first, same)
    assert record == same_record
    assert not are_equal(first, other)


def test_what_does_not_fill_an_update_is_not_taken():
    ddt = soft()
    before = parameters_of(ddt)
    record = train(ddt, fused(), PPOSettings(499, 500, 5), seed=0)
    assert (record.timesteps, record.updates, record.gradient_steps) == (0, 0, 0)
    assert math.isnan(record.soft_return)
    assert are_equal(before, parameters_of(ddt))
    assert train(ddt, fused(), PPOSettings(1499, 500, 5), seed=0).timesteps == 1000


def test_a_lone_leaf_can_be_trained():
    record = train(soft(LEFT), fused(), SETTINGS, seed=0)
    assert record.failure is None
    assert record.updates == 3


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_broken_reward_leaves_the_tree_as_it_was(value):
    def change(samples):
        samples["next", "reward"][7] = value

    ddt = soft()
    before = parameters_of(ddt)
    record = train(ddt, ChangedSource(change), SETTINGS, seed=0)
    assert record.failure == "a reward is not finite in update 2, after 5 gradient steps"
    assert (record.updates, record.gradient_steps) == (2, 5)
    assert are_equal(before, parameters_of(ddt))
    assert harden(ddt) == WRONG


def test_an_observation_that_is_no_number_leaves_the_tree_as_it_was():
    def change(samples):
        samples["observation"][3] = math.nan

    ddt = soft()
    before = parameters_of(ddt)
    record = train(ddt, ChangedSource(change), SETTINGS, seed=0)
    assert record.failure == "an observation is not finite in update 2, after 5 gradient steps"
    assert are_equal(before, parameters_of(ddt))


@pytest.mark.parametrize(
    ("settings", "failure"),
    [
        ({"lr_actor": math.inf}, "a parameter is not finite in update 1, after 0 gradient steps"),
        ({"lr_critic": 1e30}, "the loss is not finite in update 1, after 1 gradient steps"),
    ],
)
def test_a_training_beyond_all_bounds_leaves_the_tree_as_it_was(settings, failure):
    ddt = soft()
    before = parameters_of(ddt)
    record = train(ddt, fused(), replace(SETTINGS, **settings), seed=0)
    assert record.failure == failure
    assert are_equal(before, parameters_of(ddt))


def test_a_broken_gradient_leaves_the_tree_as_it_was():
    ddt = soft()
    before = parameters_of(ddt)
    passes = []

    def break_third(gradient):
        passes.append(1)
        return gradient * math.inf if len(passes) == 3 else gradient

    ddt.threshold.register_hook(break_third)
    record = train(ddt, fused(), SETTINGS, seed=0)
    assert record.failure == "a gradient is not finite in update 1, after 2 gradient steps"
    assert are_equal(before, parameters_of(ddt))
