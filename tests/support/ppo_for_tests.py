"""Trees to train for a moment, and sources whose samples are known."""

import math
from dataclasses import replace

import torch
from tensordict import TensorDict

from ge_torchrl.config import PPOConfig
from ge_torchrl.refiners.rl.actor_critic import ValueNetworks, make_actor
from ge_torchrl.refiners.rl.ddt import soften
from ge_torchrl.refiners.rl.ppo import train
from ge_torchrl.refiners.rl.snapshots import Snapshots
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
# Of different sizes: the second is padded beside the first, and so is the third, which has no split at all.
MIXED = (
    split(1, 0.25, leaf(2), split(0, -0.3, split(1, 0.9, leaf(1), leaf(0)), leaf(1))),
    split(0, 0.1, leaf(0), leaf(2)),
    leaf(1),
)
FEATURES, ACTIONS = 2, 3
LITTLE = PPOConfig(
    max_timesteps=600,
    update_timesteps=200,
    epochs=3,
    critic_hidden=(8, 8),
    standardise=False,
    snapshot_episodes=0,
    alpha=3.0,
    leaf_logit=None,
)


def hardened(ddt):
    """Return the hard trees of a DDT as a refinement without snapshots brings them back."""
    snapshots = Snapshots(None, ddt, 0, "refinement")
    snapshots.look()
    return snapshots.trees()


def config(**changes):
    return replace(LITTLE, **changes)


def unchanged(_samples, _batch):
    pass


def generators(seeds):
    return [torch.Generator().manual_seed(seed) for seed in seeds]


def drawn_samples(seed, n_steps=200, n_features=FEATURES, n_actions=ACTIONS):
    """Samples [T] of one tree with random numbers in them, drawn from a seed of its own."""
    (rng,) = generators([seed])

    def chance(p):
        return torch.rand(n_steps, 1, generator=rng) < p

    terminated, truncated = chance(0.03), chance(0.02)
    observation = torch.randn(n_steps + 1, n_features, generator=rng)
    after = {
        "observation": observation[1:],
        "reward": torch.randn(n_steps, 1, generator=rng),
        "episode_reward": torch.randn(n_steps, 1, generator=rng),
        "done": terminated | truncated,
        "terminated": terminated,
        "truncated": truncated,
    }
    before = {
        "observation": observation[:-1],
        "action": torch.randint(n_actions, (n_steps,), generator=rng),
        "action_log_prob": math.log(1 / n_actions) + 0.2 * torch.randn(n_steps, generator=rng),
    }
    return TensorDict({**before, "next": TensorDict(after, [n_steps])}, [n_steps])


class GivenSource:
    """Gives samples [R, T] that do not depend on the trees: those of each tree follow from its own seed.

    Args:
        seeds: [R].
        change: Called with the samples and the number of the batch, from 0, to spoil them.
    """

    def __init__(self, seeds, change=unchanged, **shape):
        self.seeds, self.change, self.shape, self.batches = seeds, change, shape, 0

    def collect(self, n_steps):
        samples = torch.stack(
            [drawn_samples(1000 * self.batches + seed, n_steps, **self.shape) for seed in self.seeds]
        ).contiguous()
        self.change(samples, self.batches)
        self.batches += 1
        return samples

    def close(self):
        pass


class Trained:
    """Trees after a training on given samples: the soft trees, their critics, and the records.

    Args:
        trees: The trees.
        settings: The hyperparameters.
        seeds: [R] of each tree's leaves, critic and samples; by default its place in the list.
        change: As of `GivenSource`.
    """

    def __init__(
        self,
        trees,
        settings=LITTLE,
        seeds=None,
        change=unchanged,
        after_update=lambda: None,
    ):
        seeds = range(len(trees)) if seeds is None else seeds
        rngs = generators(seeds)
        self.ddt = soften(
            trees,
            ACTIONS,
            settings.alpha,
            leaf_logit=settings.leaf_logit,
            generators=rngs,
            straight_through=settings.straight_through,
        )
        self.networks = ValueNetworks(FEATURES, settings.critic_hidden, rngs)
        self.records = train(
            self.ddt,
            make_actor(self.ddt),
            self.networks,
            GivenSource(seeds, change),
            settings,
            settings.max_timesteps,
            after_update,
        )

    def parameters_of(self, row):
        """All numbers of one tree and its critic, without padding."""
        tree = self.ddt.trees[row]
        numbers = {
            "threshold": self.ddt.threshold[row, : tree.num_decision_nodes],
            "leaf_logits": self.ddt.leaf_logits[row, : tree.num_leaves],
        }
        critic = {name: value[row] for name, value in self.networks.named_parameters()}
        return {name: value.detach().clone() for name, value in {**numbers, **critic}.items()}


def assert_close(first, second, tolerance):
    assert first.keys() == second.keys()
    for name, value in first.items():
        torch.testing.assert_close(
            value, second[name], atol=tolerance, rtol=0, msg=lambda text, n=name: f"{n}: {text}"
        )
