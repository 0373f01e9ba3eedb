"""Advantages are TorchRL's, by fewer steps: truncated episodes bootstrap, terminated ones do not."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from ppo_for_tests import drawn_samples, generators
from tensordict import TensorDict
from torchrl.objectives.value import GAE

from ge_torchrl.refiners.rl.actor_critic import ValueNetworks, make_critic
from ge_torchrl.refiners.rl.advantages import ScanGAE


def samples_of(n_steps, *, ends_every, by_truncation, reward=1.0):
    """Samples [1, T] of constant reward whose episodes end every so many steps."""
    done = (torch.arange(1, n_steps + 1) % ends_every == 0).view(1, -1, 1)
    no = torch.zeros_like(done)
    after = {
        "observation": torch.ones(1, n_steps, 4),
        "reward": torch.full((1, n_steps, 1), reward),
        "done": done,
        "truncated": done if by_truncation else no,
        "terminated": no if by_truncation else done,
    }
    return TensorDict(
        {"observation": torch.ones(1, n_steps, 4), "next": TensorDict(after, [1, n_steps])}, [1, n_steps]
    )


def constant_critic(value):
    networks = ValueNetworks(4, (8,), generators([0]))
    with torch.no_grad():
        for parameter in networks.parameters():
            parameter.zero_()
        networks.layers()[-1][1].fill_(value)
    return make_critic(networks)


@pytest.mark.parametrize("gamma", [0.5, 0.95])
def test_a_truncated_episode_bootstraps_and_a_terminated_one_does_not(gamma):
    value = 1 / (1 - gamma)
    advantages = ScanGAE(gamma=gamma, lmbda=0.9, value_network=constant_critic(value))
    truncated = advantages(samples_of(12, ends_every=4, by_truncation=True))["advantage"].flatten()
    torch.testing.assert_close(truncated, torch.zeros(12), atol=1e-4, rtol=0)
    terminated = advantages(samples_of(12, ends_every=4, by_truncation=False))["advantage"].flatten()
    # The last delta is 1 - V, those before are 0: it decays backwards, and stops where an episode began.
    decay = (gamma * 0.9) ** torch.tensor([3.0, 2.0, 1.0, 0.0])
    torch.testing.assert_close(terminated, ((1 - value) * decay).repeat(3), atol=1e-4, rtol=0)


def test_advantages_typed_by_hand():
    samples = samples_of(3, ends_every=3, by_truncation=False)
    samples["next", "reward"] = torch.tensor([[[1.0], [2.0], [3.0]]])
    result = ScanGAE(gamma=0.5, lmbda=0.5, value_network=constant_critic(10.0))(samples)
    # delta = 1 + 5 - 10, 2 + 5 - 10, 3 - 10; each advantage adds a quarter of the next one.
    np.testing.assert_allclose(result["advantage"].flatten(), [-5.1875, -4.75, -7.0], rtol=1e-6)
    np.testing.assert_allclose(result["value_target"].flatten(), [4.8125, 5.25, 3.0], rtol=1e-6)


@settings(max_examples=40)
@given(st.integers(1, 70), st.integers(1, 4), st.sampled_from([(0.995, 0.98), (0.5, 0.0), (1.0, 1.0)]))
def test_advantages_are_those_of_torchrl(n_steps, n_trees, discounts):
    gamma, lmbda = discounts
    critic = make_critic(ValueNetworks(2, (8,), generators(range(n_trees))))
    samples = torch.stack([drawn_samples(seed, n_steps) for seed in range(n_trees)]).contiguous()
    ours = ScanGAE(gamma=gamma, lmbda=lmbda, value_network=critic)(samples.clone())
    torchrls = GAE(gamma=gamma, lmbda=lmbda, value_network=critic, vectorized=False, deactivate_vmap=True)
    theirs = torchrls(samples.clone())
    for key in ("advantage", "value_target"):
        torch.testing.assert_close(ours[key], theirs[key], atol=2e-5 * math.sqrt(n_steps), rtol=1e-5)


def test_several_streams_of_a_tree_do_not_run_into_each_other():
    critic = make_critic(ValueNetworks(2, (8,), generators([0, 1])))
    advantages = ScanGAE(gamma=0.99, lmbda=0.9, value_network=critic)
    samples = torch.stack([drawn_samples(seed, 40) for seed in range(6)]).reshape(2, 3, 40)
    together = advantages(samples.clone())["advantage"]
    for stream in range(3):
        alone = advantages(samples[:, stream].clone())["advantage"]
        torch.testing.assert_close(together[:, stream], alone, atol=1e-5, rtol=1e-5)
