"""Soft trees with values: mixtures of normal distributions that become the hard tree (laws 3 and 9)."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from ppo_for_tests import BOUNDS, FEATURES, VALUES, drawn, drawn_trees, hardened, moved, standardised
from strategies import value_trees
from torch.distributions import Categorical, Independent, MixtureSameFamily, Normal

from ge_torchrl.refiners.rl.actor_critic import make_actor
from ge_torchrl.refiners.rl.distributions import GaussianMixture
from ge_torchrl.refiners.rl.gaussian import soften_values
from ge_torchrl.trees.tree import DecisionTree

few = settings(max_examples=30)
seeds = st.integers(0, 10**6)
NO_BOUNDS = np.float32([-np.inf, -np.inf]), np.float32([np.inf, np.inf])


def soft(forest, sd=0.3, alpha=5.0, n_features=FEATURES, bounds=BOUNDS, **options):
    return soften_values(forest, n_features, bounds, sd, alpha, **options)


def torchs(weights, answers, log_sd):
    parts = Independent(Normal(answers, log_sd.exp().unsqueeze(-2).expand_as(answers)), 1)
    return MixtureSameFamily(Categorical(weights), parts)


@few
@given(seeds, st.sampled_from([0.05, 0.5, 3.0]))
def test_densities_and_gradients_are_those_of_torchs_mixture(seed, sd):
    parameters = [
        drawn(seed, 2, 5, 3).softmax(-1),
        drawn(seed + 1, 2, 5, 3, 2),
        drawn(seed + 2, 2, 5, 2) + math.log(sd),
    ]
    value, gradients = 2 * drawn(seed + 3, 2, 5, 2), []
    for kind in (GaussianMixture, torchs):
        own = [p.clone().requires_grad_() for p in parameters]
        density = kind(*own).log_prob(value)
        # Torch's categorical norms its weights; so do ours, from a softmax.
        gradients.append((density.detach(), *torch.autograd.grad(density.sum(), own[1:])))
    for ours, theirs in zip(*gradients, strict=True):
        torch.testing.assert_close(ours, theirs, atol=1e-4, rtol=1e-3)


@few
@given(seeds)
def test_a_steep_tree_of_little_deviation_is_the_hard_one(seed):
    """Law 3: what is drawn is what the hard tree answers, whose numbers are those of the moves."""
    ddt = moved(standardised(soft(drawn_trees(seed, n_values=2)), seed), seed)
    with torch.no_grad():
        ddt.log_sd.fill_(-9.0)
    ddt.alpha = 1e5
    observed = drawn(seed, 3, 50, FEATURES)
    weights, answers, log_sd = (part.detach() for part in ddt(observed))
    is_sure = (weights.amax(-1) > 0.99).numpy()
    assert is_sure.mean() > 0.9
    values = GaussianMixture(weights, answers, log_sd).sample().numpy()
    expected = np.stack([tree.decide(own) for tree, own in zip(hardened(ddt), observed.numpy(), strict=True)])
    np.testing.assert_allclose(values[is_sure], expected[is_sure], atol=0.02)
    mode = GaussianMixture(weights, answers, log_sd).mode.numpy()
    np.testing.assert_allclose(mode[is_sure], expected[is_sure], atol=1e-4, rtol=1e-4)


@few
@given(st.lists(value_trees(), min_size=1, max_size=4), st.booleans(), seeds)
def test_hardening_gives_the_softened_trees_back(forest, is_standardised, seed):
    """Law 3, to the last bit."""
    ddt = soft(forest, n_features=4, bounds=NO_BOUNDS)
    if is_standardised:
        standardised(ddt, seed, n_features=4)
    assert hardened(ddt) == forest


@few
@given(seeds)
def test_standardising_keeps_what_has_moved(seed):
    ddt = moved(soft(drawn_trees(seed, n_values=2)), seed)
    before = {name: part.clone() for name, part in ddt.hard_parts().items()}
    standardised(standardised(ddt, seed), seed + 2)
    for name, part in ddt.hard_parts().items():
        torch.testing.assert_close(part, before[name], atol=1e-4, rtol=1e-4)


@few
@given(seeds)
def test_a_tree_beside_others_is_the_tree_alone(seed):
    forest, observed = drawn_trees(seed, n_values=2), drawn(seed, 3, 12, FEATURES)
    together = soft(forest)
    density = GaussianMixture(*together(observed)).log_prob(drawn(seed + 5, 3, 12, 2))
    density.sum().backward()
    for row, tree in enumerate(forest):
        alone = soft([tree])
        expected = GaussianMixture(*alone(observed[row : row + 1])).log_prob(
            drawn(seed + 5, 3, 12, 2)[row : row + 1]
        )
        torch.testing.assert_close(density[row], expected[0], atol=1e-3, rtol=1e-3)
        expected.sum().backward()
        n_leaves = tree.num_leaves
        torch.testing.assert_close(
            together.value.grad[row, :n_leaves], alone.value.grad[0, :n_leaves], atol=1e-2, rtol=1e-2
        )
        assert not together.value.grad[row, n_leaves:].any()


@few
@given(st.lists(value_trees(), min_size=1, max_size=3), seeds, st.booleans())
def test_densities_and_gradients_are_finite_everywhere(forest, seed, straight_through):
    ddt = soft(forest, n_features=4, bounds=NO_BOUNDS, straight_through=straight_through)
    far = torch.tensor([0.0, 1.0, -1e30, 3.4e38, torch.inf, -torch.inf])
    index = torch.randint(len(far), (len(forest), 8, 4), generator=torch.Generator().manual_seed(seed))
    density = GaussianMixture(*ddt(far[index])).log_prob(far[index[..., :2]].clamp(-1e38, 1e38))
    density.sum().backward()
    assert density.isfinite().all()
    assert all(p.grad is None or p.grad.isfinite().all() for p in ddt.parameters())


def test_what_is_drawn_has_the_distribution():
    """The share of draws below each of some values is that of the mixture, to four standard errors."""
    ddt = soft([VALUES[1]], sd=0.4, alpha=1.0)
    observed = torch.tensor([[0.2, -0.1]]).expand(40_000, -1)
    with torch.no_grad():
        mixture = GaussianMixture(*ddt(observed))
        torch.manual_seed(0)
        values = mixture.sample()
    weights, answers, log_sd = (part[0].detach() for part in ddt(observed[:1]))
    for entry in range(2):
        for value in (-1.0, 0.0, 0.4, 1.0, 1.5):
            below = Normal(answers[:, entry], log_sd[entry].exp()).cdf(torch.tensor(value))
            share = (weights * below).sum().item()
            error = math.sqrt(share * (1 - share) / len(values)) + 1e-9
            assert abs((values[:, entry] < value).float().mean().item() - share) < 4 * error + 1e-4
    assert mixture.entropy()[0] < -mixture.log_prob(values).mean(), "a lower bound"


def test_a_straight_through_tree_answers_hard_and_learns_soft():
    observed = drawn(0, 3, 20, FEATURES)
    hard, smooth = (soft(VALUES, alpha=2.0, straight_through=through) for through in (True, False))
    weights, answers, _ = hard(observed)
    own = (weights.unsqueeze(-1) * answers).sum(-2).detach().numpy()
    expected = [tree.decide(seen) for tree, seen in zip(VALUES, observed.numpy(), strict=True)]
    np.testing.assert_allclose(own, expected, atol=1e-5)
    weights[..., 0].sum().backward()
    smooth(observed)[0][..., 0].sum().backward()
    torch.testing.assert_close(hard.threshold.grad, smooth.threshold.grad)
    assert np.isinf(hard.soft_forest().alpha).all()


def test_units_are_halves_of_the_actions_bounds_and_one_where_there_are_none():
    ddt = soft(VALUES, sd=0.5)
    assert ddt.unit.tolist() == [2.0, 1.0]
    np.testing.assert_allclose(ddt.soft_forest().sd[:, 0], [[1.0, 0.5]] * 3)
    ddt.standardise(torch.tensor([[4.0, 0.5]]).expand(3, -1))
    np.testing.assert_allclose(ddt.leaf_weight_unit[2, 0], [[0.5, 0.25], [4.0, 2.0]])


def test_a_soft_forest_holds_the_trained_trees():
    ddt = moved(standardised(soft(VALUES), 3), 4)
    forest, observed = ddt.soft_forest(), drawn(0, 3, 6, FEATURES)
    assert not forest.has_actions
    assert forest.n_leaves == 3 - 1
    _, answers, log_sd = (part.detach().numpy() for part in ddt(observed))
    expected = forest.mean[:, None] + np.einsum("rtd,rlda->rtla", observed.numpy(), forest.leaf_weight)
    np.testing.assert_allclose(answers, expected, atol=1e-4)
    np.testing.assert_allclose(np.exp(log_sd)[:, 0], forest.sd[:, 0], rtol=1e-5)


def test_the_actor_writes_values_and_their_densities():
    from tensordict import TensorDict

    ddt = soft(VALUES)
    samples = make_actor(ddt)(TensorDict({"observation": drawn(0, 3, 4, FEATURES)}, [3, 4]))
    assert samples["action"].shape == (3, 4, 2)
    expected = torchs(*ddt(samples["observation"])).log_prob(samples["action"])
    torch.testing.assert_close(samples["action_log_prob"], expected, atol=1e-4, rtol=1e-4)


def test_softening_refuses_what_it_cannot_do():
    with pytest.raises(ValueError, match="2 values; got a tree with actions"):
        soft([DecisionTree.leaf(0)])
    with pytest.raises(ValueError, match="2 values; got a tree with 1 values"):
        soft([DecisionTree.value_leaf([0.5])])
