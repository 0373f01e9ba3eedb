"""Soft and hard trees choose alike (law 3), and gradients are those of the mixture."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from soft_trees_for_tests import hard_path_weight, mixture
from strategies import observations, renumbered_trees

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.rl.ddt import DDT, harden, soften
from ge_torchrl.trees.decision_tree import DecisionTree

TREE = DecisionTree.split(
    1, 0.25, DecisionTree.leaf(2), DecisionTree.split(0, -1.0, DecisionTree.leaf(0), DecisionTree.leaf(1))
)


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


def leaf_probabilities(ddt):
    probabilities = np.zeros((ddt.tree.n_nodes, ddt.n_actions))
    probabilities[ddt.tree.is_leaf] = ddt.leaf_logits.detach().double().softmax(-1).numpy()
    return probabilities


def log_probabilities(ddt, observed):
    with torch.no_grad():
        return ddt(torch.tensor(observed)).double().numpy()


@given(st.data(), st.sampled_from([0.5, 20.0, 1000.0]))
def test_output_is_the_mixture(data, alpha):
    tree = data.draw(renumbered_trees())
    observed = data.draw(observations(tree))
    ddt = soften(tree, 3, alpha=alpha, generator=generator())
    expected = [mixture(tree, leaf_probabilities(ddt), alpha, x) for x in observed]
    np.testing.assert_allclose(np.exp(log_probabilities(ddt, observed)), expected, atol=2e-5)


@given(st.data())
def test_one_hot_leaves_choose_the_hard_action_where_its_path_outweighs_the_rest(data):
    tree = data.draw(renumbered_trees())
    observed = data.draw(observations(tree))
    chosen = log_probabilities(soften(tree, 3, leaf_sd=0, leaf_scale=100), observed).argmax(1)
    decided = np.array([hard_path_weight(tree, 1000.0, x) for x in observed]) > 0.5 + 1e-6
    np.testing.assert_array_equal(chosen[decided], tree.decide(observed)[decided])


@pytest.mark.parametrize("threshold", [0.0, 0.1, -4.8, 3e38])
def test_each_branch_weighs_half_at_the_threshold(threshold):
    tree = DecisionTree.split(0, threshold, DecisionTree.leaf(0), DecisionTree.leaf(1))
    ddt = soften(tree, 2, leaf_sd=0, leaf_scale=100)
    np.testing.assert_allclose(np.exp(log_probabilities(ddt, tree.threshold[None, :1])), [[0.5, 0.5]])


def test_true_is_left():
    tree = DecisionTree.split(0, 0.0, DecisionTree.leaf(0), DecisionTree.leaf(1))
    ddt = soften(tree, 2, leaf_sd=0, leaf_scale=100)
    assert log_probabilities(ddt, np.float32([[-0.1], [0.1]])).argmax(1).tolist() == [0, 1]


@given(renumbered_trees())
def test_hardening_gives_the_softened_tree_back(tree):
    assert harden(soften(tree, 3, generator=generator())) == tree


def test_hardening_takes_thresholds_and_most_probable_actions():
    ddt = soften(TREE, 3, generator=generator())
    with torch.no_grad():
        ddt.threshold.copy_(torch.tensor([0.5, 0.1]))
        ddt.leaf_logits.copy_(torch.tensor([[0.0, 1.0, 0.5], [0.1, 0.0, 0.2], [3.0, 0.0, 0.0]]))
    expected = DecisionTree.split(
        1, 0.5, DecisionTree.leaf(1), DecisionTree.split(0, 0.1, DecisionTree.leaf(2), DecisionTree.leaf(0))
    )
    assert harden(ddt) == expected


def test_hardening_refuses_a_threshold_that_is_no_number():
    ddt = soften(TREE, 3, generator=generator())
    with torch.no_grad():
        ddt.threshold[1] = torch.nan
    with pytest.raises(InvalidTreeError, match="not a finite number"):
        harden(ddt)


def test_leaves_start_from_equation_3():
    ddt = soften(TREE, 3, leaf_sd=0)
    assert ddt.leaf_logits.tolist() == [[0, 0, 2], [2, 0, 0], [0, 2, 0]]
    wide = DecisionTree.leaf(1)
    logits = torch.stack([soften(wide, 3, generator=generator(seed)).leaf_logits[0] for seed in range(400)])
    np.testing.assert_allclose(logits.mean(0).tolist(), [0, 2, 0], atol=0.02)
    np.testing.assert_allclose(logits.std(0).tolist(), [0.1] * 3, atol=0.015)


def test_leaves_follow_the_generator():
    first, same, other = (soften(TREE, 3, generator=generator(seed)).leaf_logits for seed in (1, 1, 2))
    assert torch.equal(first, same)
    assert not torch.equal(first, other)


def test_softening_needs_a_generator_and_enough_actions():
    with pytest.raises(ValueError, match="generator"):
        soften(TREE, 3)
    with pytest.raises(ValueError, match="only 2 actions"):
        soften(TREE, 2, generator=generator())


def test_gradients_are_those_of_finite_differences():
    ddt = soften(TREE, 3, alpha=5.0, generator=generator()).double()
    observed = torch.randn(7, 2, generator=generator(), dtype=torch.float64)

    def output(threshold, leaf_logits):
        parameters = {"threshold": threshold, "leaf_logits": leaf_logits}
        return torch.func.functional_call(ddt, parameters, (observed,))

    assert torch.autograd.gradcheck(output, (ddt.threshold, ddt.leaf_logits))


@given(st.data(), st.sampled_from([0.1, 1.0, 100.0]))
def test_values_and_gradients_are_finite_everywhere(data, leaf_scale):
    tree = data.draw(renumbered_trees())
    observed = data.draw(observations(tree, near=[3.4028235e38, -3.4028235e38, np.inf, -np.inf]))
    ddt = soften(tree, 3, leaf_sd=0, leaf_scale=leaf_scale)
    output = ddt(torch.from_numpy(observed))
    for action in range(3):
        ddt.zero_grad()
        output[:, action].sum().backward(retain_graph=True)
        assert all(p.grad.isfinite().all() for p in ddt.parameters())
    assert output.isfinite().all()
    np.testing.assert_allclose(output.detach().exp().sum(-1), 1, atol=1e-5)


def test_alpha_may_be_changed():
    ddt = soften(TREE, 3, alpha=1000.0, leaf_sd=0, leaf_scale=100)
    observed = np.float32([[0.0, 0.0]])
    assert np.exp(log_probabilities(ddt, observed))[0, 2] == pytest.approx(1)
    ddt.alpha = 1.0
    assert np.exp(log_probabilities(ddt, observed))[0, 2] == pytest.approx(1 / (1 + np.exp(-0.25)))
    assert ddt.arrays().alpha.tolist() == [1.0] * TREE.n_nodes


def test_one_observation_and_a_batch_of_batches_give_the_same():
    ddt = soften(TREE, 3, alpha=3.0, generator=generator())
    observed = torch.randn(2, 5, 2, generator=generator())
    together = ddt(observed)
    assert together.shape == (2, 5, 3)
    torch.testing.assert_close(together[1, 3], ddt(observed[1, 3]))


def test_arrays_hold_the_trained_tree():
    ddt = soften(TREE, 3, generator=generator())
    with torch.no_grad():
        ddt.threshold += 1
    arrays = ddt.arrays()
    np.testing.assert_array_equal(arrays.threshold, [1.25, 0, 0, 0, 0])
    np.testing.assert_allclose(arrays.probabilities[TREE.is_leaf].sum(1), 1)
    assert arrays.probabilities[TREE.is_leaf].argmax(1).tolist() == TREE.action[TREE.is_leaf].tolist()


def test_only_thresholds_and_leaves_are_trained():
    ddt = DDT(TREE, torch.zeros(3, 3))
    assert {name for name, _ in ddt.named_parameters()} == {"threshold", "leaf_logits"}


@given(st.data(), st.sampled_from([0.5, 20.0]))
def test_a_standardised_tree_is_the_same_hard_tree_with_decisions_as_steep_as_its_features_are_narrow(
    data, alpha
):
    tree = data.draw(renumbered_trees())
    observed = data.draw(observations(tree))
    spread = torch.tensor([2.0 ** (j % 5 - 2) for j in range(observed.shape[1])])
    ddt = soften(tree, 3, alpha=alpha, generator=generator())
    leaves = harden(ddt).action
    ddt.standardise(spread)
    np.testing.assert_array_equal(harden(ddt).threshold, tree.threshold)
    np.testing.assert_array_equal(harden(ddt).action, leaves)
    steepness = ddt.arrays().alpha
    decisions = ~tree.is_leaf
    np.testing.assert_array_equal(steepness[decisions], alpha / spread.numpy()[tree.feature[decisions]])
    expected = [mixture(tree, leaf_probabilities(ddt), steepness, x) for x in observed]
    np.testing.assert_allclose(np.exp(log_probabilities(ddt, observed)), expected, atol=2e-5)
