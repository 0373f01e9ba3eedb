"""The loss is TorchRL's, tree by tree."""

import pytest
import torch
from ppo_for_tests import ACTIONS, MIXED, drawn_samples, generators
from torchrl.objectives import ClipPPOLoss

from ge_torchrl.refiners.rl.actor_critic import ValueNetworks, make_actor, make_critic
from ge_torchrl.refiners.rl.advantages import ScanGAE
from ge_torchrl.refiners.rl.ddt import soften
from ge_torchrl.refiners.rl.loss import TreesPPOLoss

LOSSES = ("loss_objective", "loss_critic", "loss_entropy")


def parts(seeds=(0, 1, 2)):
    ddt = soften(MIXED, ACTIONS, alpha=2.0, generators=generators(seeds))
    networks = ValueNetworks(2, (8,), generators(seeds))
    critic = make_critic(networks)
    samples = torch.stack([drawn_samples(seed) for seed in seeds]).contiguous()
    samples["action_log_prob"] *= 1.2
    ScanGAE(gamma=0.9, lmbda=0.9, value_network=critic)(samples)
    return [*ddt.parameters(), *networks.parameters()], make_actor(ddt), critic, samples


@pytest.mark.parametrize("clip_epsilon", [0.05, 0.2, 1.0])
def test_losses_and_gradients_are_those_of_torchrl(clip_epsilon):
    parameters, actor, critic, samples = parts()
    torchrls = ClipPPOLoss(
        actor,
        critic,
        clip_epsilon=clip_epsilon,
        entropy_coeff=0.03,
        critic_coeff=0.5,
        loss_critic_type="l2",
        normalize_advantage=True,
        normalize_advantage_exclude_dims=(0,),
        reduction="none",
        functional=False,
    )
    results = []
    for loss in (TreesPPOLoss(actor, critic, clip_epsilon, 0.03), torchrls):
        losses = loss(samples)
        gradients = torch.autograd.grad(sum(losses[name].mean(1).sum() for name in LOSSES), parameters)
        results.append(([losses[name] for name in LOSSES], gradients))
    for ours, theirs in zip(*results, strict=True):
        torch.testing.assert_close(ours, theirs, atol=1e-7, rtol=1e-6)


def test_it_is_a_loss_of_torchrl_whose_entropy_weight_may_be_changed():
    _, actor, critic, samples = parts()
    loss = TreesPPOLoss(actor, critic, 0.2, 0.03)
    assert isinstance(loss, ClipPPOLoss)
    before = loss(samples)["loss_entropy"]
    loss.entropy_coeff.fill_(0.06)
    torch.testing.assert_close(loss(samples)["loss_entropy"], 2 * before)


def test_samples_stay_as_they_are():
    _, actor, critic, samples = parts()
    keys = set(samples.keys())
    TreesPPOLoss(actor, critic, 0.2, 0.03)(samples)
    assert set(samples.keys()) == keys
