"""A tree that is wrong, and what trains it for a moment."""

import numpy as np
import torch

from ge_torchrl.environments.spec import describe
from ge_torchrl.rl.ddt import soften
from ge_torchrl.rl.ppo import PPOSettings
from ge_torchrl.rl.samples import open_source
from ge_torchrl.trees.decision_tree import DecisionTree

LEFT, RIGHT = DecisionTree.leaf(0), DecisionTree.leaf(1)
# It pushes the cart away from where the pole falls.
WRONG = DecisionTree.split(3, 0.0, RIGHT, LEFT)
SETTINGS = PPOSettings(max_timesteps=1500, update_timesteps=500, epochs=5, hidden=(16, 16))
CARTPOLE = describe("CartPole-v1")


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


def soft(tree=WRONG):
    return soften(tree, 2, generator=generator())


def fused(seed=0):
    return open_source(CARTPOLE, "fused", rng=np.random.default_rng(seed))


def parameters_of(ddt):
    return {name: value.detach().clone() for name, value in ddt.named_parameters()}


def are_equal(first, second):
    return all(torch.equal(value, second[name]) for name, value in first.items())
