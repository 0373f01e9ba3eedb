"""Soft trees of weighted sums: what holds of axis-aligned ones holds of them, side by side with these too."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from ppo_for_tests import (
    ACTIONS,
    FEATURES,
    OBLIQUE,
    drawn,
    drawn_trees,
    generators,
    hardened,
    leaf,
    moved,
    standardised,
)
from soft_forests_for_tests import mixtures
from strategies import weighted_trees

from ge_torchrl.refiners.rl.ddt import soften
from ge_torchrl.trees.tree import DecisionTree

few = settings(max_examples=30)
seeds = st.integers(0, 10**6)


def soft(forest, alpha=5.0, leaf_sd=0.1, **options):
    return soften(forest, ACTIONS, alpha, leaf_sd, generators=generators(range(len(forest))), **options)


@few
@given(seeds, st.sampled_from([0.5, 5.0, 50.0]))
def test_output_is_the_mixture(seed, alpha):
    ddt = moved(standardised(soft(drawn_trees(seed), alpha), seed), seed)
    observed = drawn(seed, 3, 9, FEATURES)
    expected = [mixtures(ddt.soft_forest(), row, own) for row, own in enumerate(observed.numpy())]
    np.testing.assert_allclose(ddt(observed).detach().double().exp(), expected, atol=1e-4)


@few
@given(seeds)
def test_a_steep_tree_acts_as_the_hard_one(seed):
    """Law 3: where the hard path has next to all weight, it decides; its numbers are those of the moves."""
    ddt = moved(standardised(soft(drawn_trees(seed), leaf_sd=0, leaf_logit=20.0), seed), seed, 0.1)
    observed = drawn(seed, 3, 50, FEATURES)
    ddt.alpha = 1e5
    probabilities = ddt(observed).detach().exp().numpy()
    is_sure = probabilities.max(2) > 0.99
    assert is_sure.mean() > 0.9
    expected = np.stack([tree.decide(own) for tree, own in zip(hardened(ddt), observed.numpy(), strict=True)])
    np.testing.assert_array_equal(probabilities.argmax(2)[is_sure], expected[is_sure])


@few
@given(st.lists(weighted_trees(), min_size=1, max_size=4), st.booleans(), seeds)
def test_hardening_gives_the_softened_trees_back(forest, is_standardised, seed):
    """Law 3, to the last bit."""
    ddt = soft(forest)
    if is_standardised:
        standardised(ddt, seed, n_features=4)
    assert hardened(ddt) == forest


@few
@given(seeds)
def test_a_straight_through_tree_acts_as_the_hard_one_everywhere(seed):
    ddt = soft(drawn_trees(seed), alpha=1.0, leaf_sd=0, leaf_logit=5.0, straight_through=True)
    moved(standardised(ddt, seed), seed, 0.1)
    # Thresholds are met exactly where features are whole numbers.
    observed = torch.cat([drawn(seed, 3, 20, FEATURES), drawn(seed, 3, 20, FEATURES).round()], 1)
    chosen = ddt(observed).argmax(2).numpy()
    expected = [tree.decide(own) for tree, own in zip(hardened(ddt), observed.numpy(), strict=True)]
    np.testing.assert_array_equal(chosen, expected)


@few
@given(seeds)
def test_standardising_keeps_what_has_moved(seed):
    ddt = moved(soft(drawn_trees(seed)), seed)
    before = {name: part.clone() for name, part in ddt.hard_parts().items()}
    standardised(ddt, seed)
    standardised(ddt, seed + 2)
    for name, part in ddt.hard_parts().items():
        torch.testing.assert_close(part, before[name], atol=1e-4, rtol=1e-4)


@few
@given(seeds)
def test_a_tree_beside_others_is_the_tree_alone(seed):
    """Axis-aligned ones among them, and there is no gradient of padding and of lone weights."""
    forest = [*drawn_trees(seed), DecisionTree.split(1, 0.3, leaf(0), leaf(2))]
    observed = drawn(seed, 4, 12, FEATURES)
    together = standardised(soft(forest), seed)
    output = together(observed)
    output.exp()[..., 0].sum().backward()
    for row, tree in enumerate(forest):
        alone = soften([tree], ACTIONS, 5.0, generators=generators([row]))
        alone.standardise(
            drawn(seed, 4, FEATURES).exp()[row : row + 1], 3 * drawn(seed + 1, 4, FEATURES)[row : row + 1]
        )
        expected = alone(observed[row : row + 1])
        torch.testing.assert_close(output[row], expected[0], atol=1e-4, rtol=1e-4)
        expected.exp()[..., 0].sum().backward()
        n_splits = tree.num_decision_nodes
        torch.testing.assert_close(
            together.threshold.grad[row, :n_splits], alone.threshold.grad[0, :n_splits], atol=1e-4, rtol=1e-3
        )
        assert not together.threshold.grad[row, n_splits:].any()
        if together.weight is not None:
            is_free = together.weight_unit[row] > 0
            assert not together.weight.grad[row][~is_free].any()
            assert is_free.sum() == len(tree.parameters) - n_splits


@few
@given(st.lists(weighted_trees(), min_size=1, max_size=4), seeds, st.booleans())
def test_values_and_gradients_are_finite_everywhere(forest, seed, straight_through):
    ddt = soft(forest, straight_through=straight_through)
    far = torch.tensor([0.0, 1.0, -1e30, 3.4e38, torch.inf, -torch.inf])
    index = torch.randint(len(far), (len(forest), 8, 4), generator=torch.Generator().manual_seed(seed))
    output = ddt(far[index])
    output[..., 0].sum().backward()
    assert output.isfinite().all()
    assert all(parameter.grad.isfinite().all() for parameter in ddt.parameters())


def test_gradients_are_those_of_finite_differences():
    ddt = standardised(soft(OBLIQUE), 1).double()
    observed = drawn(0, 3, 7, FEATURES).double()
    names = ["threshold", "weight", "leaf_logits"]

    def output(*parameters):
        return torch.func.functional_call(ddt, dict(zip(names, parameters, strict=True)), (observed,))

    assert torch.autograd.gradcheck(output, tuple(getattr(ddt, name) for name in names))


def test_a_weight_counts_in_what_moves_its_sum_as_far_as_the_sum_spreads():
    (tree,) = [DecisionTree.weighted_split([0, 1], [3.0, 0.4], 0.0, leaf(0), leaf(1))]
    ddt = soft([tree])
    ddt.standardise(torch.tensor([[1.0, 10.0]]))
    assert ddt.scale.tolist() == [[pytest.approx(5.0)]]
    np.testing.assert_allclose(ddt.weight_unit[0, 0], [5.0, 0.5])
    assert ddt.soft_forest().alpha.tolist() == [[pytest.approx(1.0)]]
