"""Trees to train for a moment, and sources whose samples are known."""

import math
from dataclasses import replace

import numpy as np
import torch
from tensordict import TensorDict

from ge_torchrl.config import PPOConfig
from ge_torchrl.refiners.rl.actor_critic import ValueNetworks, make_actor
from ge_torchrl.refiners.rl.ddt import soften
from ge_torchrl.refiners.rl.gaussian import soften_values
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
BOUNDS = np.float32([-2, -math.inf]), np.float32([2, math.inf])
OBLIQUE = (
    DecisionTree.weighted_split([0, 1], [1.0, -0.5], 0.2, leaf(2), split(0, -0.3, leaf(1), leaf(0))),
    split(1, 0.1, leaf(0), DecisionTree.weighted_split([0], [-2.0], 0.1, leaf(1), leaf(2))),
    leaf(1),
)
VALUES = (
    split(
        1, 0.25, DecisionTree.value_leaf([0.5, 1.0], {1: [0.3, -0.2]}), DecisionTree.value_leaf([-0.5, 0.0])
    ),
    DecisionTree.weighted_split(
        [0, 1], [1.0, 2.0], 0.1, DecisionTree.value_leaf([1.0, 0.0]), DecisionTree.value_leaf([0.0, 1.0])
    ),
    DecisionTree.value_leaf([0.3, 0.2], {0: [1.0, 0.5], 1: [-1.0, 0.5]}),
)
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


def softened(trees, settings, rngs):
    """The soft trees, of whichever kind."""
    options = {"alpha": settings.alpha, "straight_through": settings.straight_through}
    if trees[0].has_actions:
        return soften(trees, ACTIONS, leaf_logit=settings.leaf_logit, generators=rngs, **options)
    bounds = tuple(bound[: trees[0].value.shape[1]] for bound in BOUNDS)
    return soften_values(trees, FEATURES, bounds, **options)


def drawn_samples(seed, n_steps=200, n_features=FEATURES, n_actions=ACTIONS, n_values=0):
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
    if n_values > 0:
        values = torch.randn(n_steps, n_values, generator=rng)
        before["action"], before["action_log_prob"] = values, -0.5 * values.square().sum(-1) - n_values
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
        self.ddt = softened(trees, settings, rngs)
        self.networks = ValueNetworks(FEATURES, settings.critic_hidden, rngs)
        self.records = train(
            self.ddt,
            make_actor(self.ddt),
            self.networks,
            GivenSource(seeds, change, n_values=trees[0].value.shape[1]),
            settings,
            settings.max_timesteps,
            after_update,
        )

    def parameters_of(self, row):
        """All numbers of one tree and its critic, without padding."""
        tree = self.ddt.trees[row]
        ddt, n_leaves = self.ddt, tree.num_leaves
        numbers = {"threshold": ddt.threshold[row, : tree.num_decision_nodes]}
        if not tree.is_axis_aligned:
            numbers["weight"] = ddt.weight[row][ddt.weight_unit[row] > 0]
        if tree.has_actions:
            numbers["leaf_logits"] = ddt.leaf_logits[row, :n_leaves]
        else:
            numbers |= {"value": ddt.value[row, :n_leaves], "log_sd": ddt.log_sd[row]}
        if len(tree.leaf_feature) > 0:
            numbers["leaf_weight"] = ddt.leaf_weight[row][ddt.leaf_weight_unit[row] > 0]
        critic = {name: value[row] for name, value in self.networks.named_parameters()}
        return {name: value.detach().clone() for name, value in {**numbers, **critic}.items()}


def assert_close(first, second, tolerance):
    assert first.keys() == second.keys()
    for name, value in first.items():
        torch.testing.assert_close(
            value, second[name], atol=tolerance, rtol=0, msg=lambda text, n=name: f"{n}: {text}"
        )


def drawn_trees(seed, n_values=0, n_trees=3):
    """Trees of every size up to three splits of one to three terms, whose numbers are never equal."""
    rng = np.random.default_rng(seed)

    def drawn_leaf():
        if n_values == 0:
            return leaf(int(rng.integers(ACTIONS)))
        terms = rng.choice(FEATURES, rng.integers(FEATURES + 1), replace=False)
        linear = {int(feature): rng.normal(size=n_values).tolist() for feature in terms}
        return DecisionTree.value_leaf(rng.normal(size=n_values).tolist(), linear)

    def grown(n_splits):
        if n_splits == 0:
            return drawn_leaf()
        n_terms, n_left = int(rng.integers(1, 4)), int(rng.integers(n_splits))
        features, weights = rng.integers(FEATURES, size=n_terms).tolist(), rng.normal(size=n_terms).tolist()
        halves = grown(n_left), grown(n_splits - 1 - n_left)
        return DecisionTree.weighted_split(features, weights, float(rng.normal()), *halves)

    return [grown(int(rng.integers(4))) for _ in range(n_trees)]


def drawn(seed, *shape):
    """Standard normal numbers of a seed."""
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


@torch.no_grad()
def moved(ddt, seed, size=0.3):
    """Move all parameters, as a training does."""
    for number, parameter in enumerate(ddt.parameters()):
        parameter.add_(size * drawn(seed + number, *parameter.shape))
    return ddt


def standardised(ddt, seed, n_features=FEATURES):
    """Count numbers in units of drawn spreads, around means far from 0."""
    shape = (ddt.num_trees, n_features)
    ddt.standardise(drawn(seed, *shape).exp(), 3 * drawn(seed + 1, *shape))
    return ddt
