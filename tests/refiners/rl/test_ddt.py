"""Soft and hard trees choose alike (law 3), side by side as alone, and gradients are those of the mixture."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from ppo_for_tests import ACTIONS, MIXED, generators, hardened, leaf, split
from soft_forests_for_tests import mixtures
from strategies import observations, trees

from ge_torchrl.refiners.rl.ddt import DDT, soften
from ge_torchrl.trees.tree import DecisionTree

TREE = MIXED[0]
forests = st.lists(trees(), min_size=1, max_size=4)
# Each example is several trees and observations.
few = settings(max_examples=40)


@st.composite
def observed_forests(draw, near=()):
    """Trees, and observations [R, B, D] of each."""
    forest = draw(forests)
    seen = [draw(observations(tree, near=near)) for tree in forest]
    return forest, np.stack([rows[np.arange(8) % len(rows)] for rows in seen])


def soft(forest, alpha=1000.0, leaf_sd=0.1, leaf_logit=None, n_actions=ACTIONS, **options):
    return soften(forest, n_actions, alpha, leaf_sd, leaf_logit, generators(range(len(forest))), **options)


def log_probabilities(ddt, observed):
    with torch.no_grad():
        return ddt(torch.tensor(observed)).double().numpy()


@few
@given(observed_forests(), st.sampled_from([0.5, 20.0, 1000.0]))
def test_output_is_the_mixture(case, alpha):
    forest, observed = case
    ddt = soft(forest, alpha)
    expected = [mixtures(ddt.soft_forest(), row, own) for row, own in enumerate(observed)]
    np.testing.assert_allclose(np.exp(log_probabilities(ddt, observed)), expected, atol=2e-5)


@few
@given(observed_forests())
def test_sure_leaves_choose_the_hard_action_where_its_path_outweighs_the_rest(case):
    forest, observed = case
    ddt = soft(forest, leaf_sd=0, leaf_logit=200.0)
    chosen, form = log_probabilities(ddt, observed).argmax(2), ddt.soft_forest()
    # With a leaf's number for its action, a mixture gives the weights of the leaves.
    numbered = form._replace(probabilities=np.tile(np.eye(form.probabilities.shape[1]), (len(forest), 1, 1)))
    for row, (tree, own) in enumerate(zip(forest, observed, strict=True)):
        weight = mixtures(numbered, row, own)[np.arange(len(own)), tree.leaf_of(own)]
        decided = weight > 0.5 + 1e-5
        np.testing.assert_array_equal(chosen[row, decided], tree.decide(own)[decided])


@few
@given(observed_forests())
def test_a_straight_through_tree_acts_as_the_hard_one_everywhere(case):
    forest, observed = case
    ddt = soft(forest, alpha=1.0, leaf_sd=0, leaf_logit=5.0, straight_through=True)
    chosen = log_probabilities(ddt, observed).argmax(2)
    np.testing.assert_array_equal(
        chosen, [tree.decide(own) for tree, own in zip(forest, observed, strict=True)]
    )
    assert np.isinf(ddt.soft_forest().alpha).all()


def test_a_straight_through_tree_has_the_gradient_of_its_soft_paths():
    """With p = sum_l w_l q_l, the gradient is that of the soft w with the hard p under the logarithm."""
    observed = torch.randn(3, 7, 2, generator=torch.Generator().manual_seed(0))
    hard, smooth = (soft(MIXED, alpha=2.0, straight_through=through) for through in (True, False))
    hard(observed)[..., 0].exp().sum().backward()
    smooth(observed)[..., 0].exp().sum().backward()
    torch.testing.assert_close(hard.threshold.grad, smooth.threshold.grad, atol=1e-6, rtol=1e-5)


@pytest.mark.parametrize("threshold", [0.0, 0.1, -4.8, 3e38])
def test_each_branch_weighs_half_at_the_threshold(threshold):
    tree = split(0, threshold, leaf(0), leaf(1))
    ddt = soft([tree], leaf_sd=0, leaf_logit=100.0, n_actions=2)
    at = np.full((1, 1, 1), tree.threshold[0])
    np.testing.assert_allclose(np.exp(log_probabilities(ddt, at)), [[[0.5, 0.5]]])


def test_true_is_left():
    ddt = soft([split(0, 0.0, leaf(0), leaf(1))], leaf_sd=0, leaf_logit=100.0, n_actions=2)
    assert log_probabilities(ddt, np.float32([[[-0.1], [0.1]]])).argmax(2).tolist() == [[0, 1]]


@few
@given(forests, st.booleans())
def test_hardening_gives_the_softened_trees_back(forest, is_standardised):
    ddt = soft(forest)
    if is_standardised:
        ddt.standardise(torch.tensor([[3.0, 1e-3, 7e4, 0.1]]).expand(len(forest), -1))
    assert hardened(ddt) == forest


def test_hardening_takes_thresholds_and_most_probable_actions():
    ddt = soft(MIXED)
    with torch.no_grad():
        ddt.threshold[0] = torch.tensor([0.25, 0.4, 0.1])
        ddt.leaf_logits[0] = torch.eye(3)[[1, 2, 0, 1]]
    expected = split(
        1,
        0.5,
        leaf(1),
        split(0, np.float32(-0.3) + np.float32(0.4), split(1, 1.0, leaf(2), leaf(0)), leaf(1)),
    )
    first, *others = hardened(ddt)
    assert first == expected
    assert others == list(MIXED[1:])


def test_leaves_start_from_equation_3_or_from_the_lead_that_is_asked_for():
    tree = split(0, 0.0, leaf(2), leaf(0))
    assert soft([tree], leaf_sd=0).leaf_logits.tolist() == [[[0, 0, 2], [2, 0, 0]]]
    assert soft([tree], leaf_sd=0, leaf_logit=5.0).leaf_logits.tolist() == [[[0, 0, 5], [5, 0, 0]]]
    logits = soft([leaf(1)] * 400).leaf_logits[:, 0]
    np.testing.assert_allclose(logits.mean(0).tolist(), [0, 2, 0], atol=0.02)
    np.testing.assert_allclose(logits.std(0).tolist(), [0.1] * 3, atol=0.015)


def test_leaves_follow_their_own_generator_and_not_what_stands_beside_them():
    alone = soften([MIXED[1]], ACTIONS, generators=generators([1])).leaf_logits
    beside = soft(MIXED).leaf_logits[1, :2]
    assert torch.equal(alone[0], beside)
    assert not torch.equal(alone, soften([MIXED[1]], ACTIONS, generators=generators([2])).leaf_logits)


def test_softening_refuses_what_it_cannot_do():
    with pytest.raises(ValueError, match="generators"):
        soften([TREE], ACTIONS)
    with pytest.raises(ValueError, match="only 2 actions"):
        soft([TREE], n_actions=2)
    with pytest.raises(ValueError, match="leaves with actions"):
        soft([DecisionTree.value_leaf([0.5])])


def test_gradients_are_those_of_finite_differences():
    ddt = soft(MIXED, alpha=5.0).double()
    observed = torch.randn(3, 7, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64)

    def output(threshold, leaf_logits):
        parameters = {"threshold": threshold, "leaf_logits": leaf_logits}
        return torch.func.functional_call(ddt, parameters, (observed,))

    assert torch.autograd.gradcheck(output, (ddt.threshold, ddt.leaf_logits))


@few
@given(
    observed_forests(near=[3.4028235e38, -3.4028235e38, np.inf, -np.inf]),
    st.sampled_from([0.1, 2.0, 200.0]),
    st.booleans(),
)
def test_values_and_gradients_are_finite_everywhere(case, leaf_logit, straight_through):
    forest, observed = case
    ddt = soft(forest, leaf_sd=0, leaf_logit=leaf_logit, straight_through=straight_through)
    output = ddt(torch.from_numpy(observed))
    for action in range(ACTIONS):
        ddt.zero_grad()
        output[..., action].sum().backward(retain_graph=True)
        assert all(p.grad.isfinite().all() for p in ddt.parameters())
    assert output.isfinite().all()
    np.testing.assert_allclose(output.detach().exp().sum(-1), 1, atol=1e-5)


@few
@given(observed_forests(), st.sampled_from([0.5, 20.0]))
def test_padding_leaves_no_trace(case, alpha):
    """A tree beside others has the values and gradients that it has alone, and its padding has no gradient."""
    forest, observed = case
    together = soft(forest, alpha)
    output = together(torch.from_numpy(observed))
    output.exp()[..., 0].sum().backward()
    for row, tree in enumerate(forest):
        alone = soften([tree], ACTIONS, alpha, generators=generators([row]))
        expected = alone(torch.from_numpy(observed[row : row + 1]))
        torch.testing.assert_close(output[row], expected[0], atol=1e-5, rtol=1e-5)
        expected.exp()[..., 0].sum().backward()
        for name, n_own in (("threshold", tree.num_decision_nodes), ("leaf_logits", tree.num_leaves)):
            gradient = getattr(together, name).grad[row]
            torch.testing.assert_close(
                gradient[:n_own], getattr(alone, name).grad[0, :n_own], atol=1e-4, rtol=1e-4
            )
            assert not gradient[n_own:].any()


@pytest.mark.parametrize("dtype", [torch.float64, torch.int64, torch.float16])
def test_observations_of_any_type_are_read(dtype):
    ddt = soft(MIXED, alpha=2.0)
    observed = torch.randint(-3, 3, (3, 5, 2), generator=torch.Generator().manual_seed(0))
    assert torch.equal(ddt(observed.to(dtype)), ddt(observed.float()))


def test_rows_are_equal_runs_of_the_trees():
    ddt = soft(MIXED, alpha=2.0)
    observed = torch.randn(3, 4, 5, 2, generator=torch.Generator().manual_seed(0))
    nested = ddt(observed)
    assert nested.shape == (3, 4, 5, 3)
    assert torch.equal(nested, ddt(observed.reshape(60, 2)).reshape(nested.shape))
    assert torch.equal(nested[:, 1], ddt(observed[:, 1]))


def test_alpha_may_be_changed():
    ddt = soft([split(1, 0.25, leaf(2), leaf(0))], leaf_sd=0, leaf_logit=200.0)
    observed = np.float32([[[0.0, 0.0]]])
    assert np.exp(log_probabilities(ddt, observed))[0, 0, 2] == pytest.approx(1)
    ddt.alpha = 1.0
    assert np.exp(log_probabilities(ddt, observed))[0, 0, 2] == pytest.approx(1 / (1 + np.exp(-0.25)))
    assert ddt.soft_forest().alpha.tolist() == [[1.0]]


def test_a_soft_forest_holds_the_trained_trees():
    ddt = soft(MIXED)
    with torch.no_grad():
        ddt.threshold += 1
    forest = ddt.soft_forest()
    np.testing.assert_array_equal(forest.threshold[:, 0], np.float32([1.25, 1.1, 1.0]))
    np.testing.assert_allclose(forest.probabilities.sum(2), 1)
    for row, tree in enumerate(MIXED):
        assert forest.probabilities[row, : tree.num_leaves].argmax(1).tolist() == tree.action.tolist()
        assert (forest.children_left[row, tree.num_decision_nodes :] == ~0).all()
        assert (forest.children_right[row, tree.num_decision_nodes :] == ~0).all()


def test_only_thresholds_and_leaves_are_trained():
    ddt = DDT([TREE], torch.zeros(1, 4, 3))
    assert {name for name, _ in ddt.named_parameters()} == {"threshold", "leaf_logits"}


@few
@given(observed_forests(), st.sampled_from([0.5, 20.0]))
def test_a_standardised_tree_is_the_same_hard_tree_with_splits_as_steep_as_its_features_are_narrow(
    case, alpha
):
    forest, observed = case
    spread = torch.tensor([[2.0 ** ((j + row) % 5 - 2) for j in range(4)] for row in range(len(forest))])
    ddt = soft(forest, alpha)
    ddt.standardise(spread)
    steepness = ddt.soft_forest().alpha
    for row, tree in enumerate(forest):
        own = steepness[row, : tree.num_decision_nodes]
        np.testing.assert_array_equal(own, alpha / spread[row].double().numpy()[tree.feature])
    expected = [mixtures(ddt.soft_forest(), row, own) for row, own in enumerate(observed)]
    np.testing.assert_allclose(np.exp(log_probabilities(ddt, observed)), expected, atol=2e-5)


def test_standardising_keeps_what_has_moved():
    ddt = soft(MIXED)
    with torch.no_grad():
        ddt.threshold += 0.5
    before = ddt.thresholds()
    ddt.standardise(torch.tensor([[3.0, 0.7]]).expand(3, -1))
    torch.testing.assert_close(ddt.thresholds(), before, atol=1e-7, rtol=1e-6)
