import numpy as np
import pytest
import torch
from ppo_for_tests import ACTIONS, MIXED, generators
from tensordict import TensorDict
from torch.distributions import Categorical
from torchrl.envs.utils import ExplorationType, set_exploration_type

from ge_torchrl.refiners.rl.actor_critic import ValueNetworks, make_actor, make_critic
from ge_torchrl.refiners.rl.ddt import soften
from ge_torchrl.refiners.rl.distributions import LogCategorical


def soft():
    return soften(MIXED, ACTIONS, alpha=2.0, leaf_sd=0)


def networks(seeds=(0, 1, 2), hidden=(5, 7), n_features=4):
    return ValueNetworks(n_features, hidden, generators(seeds))


def observation(*shape, n_features=2):
    return torch.randn(*shape, n_features, generator=torch.Generator().manual_seed(0))


class Given:
    """Uniform numbers that are known."""

    def __init__(self, numbers):
        self.numbers = numbers

    def next(self):
        return torch.tensor(self.numbers)


def test_actor_writes_an_integer_action_and_the_trees_own_log_probability():
    ddt, observed = soft(), observation(3, 6)
    with torch.random.fork_rng(devices=[]), torch.no_grad(), set_exploration_type(ExplorationType.RANDOM):
        output = make_actor(ddt)(TensorDict({"observation": observed}, [3, 6]))
        expected = ddt(observed)
    assert output["action"].dtype == torch.int64
    chosen = expected.gather(2, output["action"].unsqueeze(2)).squeeze(2)
    torch.testing.assert_close(output["action_log_prob"], chosen)


def test_actor_shares_the_trees_parameters():
    ddt = soft()
    assert {id(p) for p in make_actor(ddt).parameters()} == {id(p) for p in ddt.parameters()}


def test_the_distribution_is_torchs_own_where_its_logits_are_log_probabilities():
    logits = observation(4, n_features=3).log_softmax(-1)
    action = torch.tensor([0, 1, 2, 1])
    ours, torchs = LogCategorical(logits), Categorical(logits=logits)
    torch.testing.assert_close(ours.log_prob(action), torchs.log_prob(action))
    torch.testing.assert_close(ours.entropy(), torchs.entropy())
    torch.testing.assert_close(ours.probs, torchs.probs)
    assert torch.equal(ours.mode, torchs.mode)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        assert ours.sample((5,)).shape == (5, 4)


def test_given_numbers_decide_actions_by_their_place_among_the_probabilities():
    logits = torch.tensor([[0.2, 0.5, 0.3]]).log().expand(6, 3)
    drawn = LogCategorical(logits, draws=Given([0.0, 0.19, 0.21, 0.69, 0.71, 1.0])).sample()
    assert drawn.tolist() == [0, 0, 1, 1, 2, 2]
    assert drawn.dtype == torch.int64


def test_critics_are_relu_networks_of_the_hidden_widths_each_with_weights_of_its_own():
    stacked = networks()
    shapes = [(tuple(weight.shape), tuple(bias.shape)) for weight, bias in stacked.layers()]
    assert shapes == [((3, 5, 4), (3, 5, 1)), ((3, 7, 5), (3, 7, 1)), ((3, 1, 7), (3, 1, 1))]
    observed = observation(3, 6, n_features=4)
    output = make_critic(stacked)(TensorDict({"observation": observed}, [3, 6]))["state_value"]
    assert output.shape == (3, 6, 1)
    for row in range(3):
        columns = observed[row]
        for i, (weight, bias) in enumerate(stacked.layers()):
            columns = torch.nn.functional.linear(
                columns if i == 0 else columns.relu(), weight[row], bias[row, :, 0]
            )
        torch.testing.assert_close(output[row], columns)


def test_a_critic_may_have_no_hidden_layer():
    assert networks(hidden=())(observation(3, 6, n_features=4)).shape == (3, 6, 1)


def test_first_weights_are_those_of_torchs_layers():
    """Uniform within one over the root of the number of inputs."""
    weight, bias = networks(range(200), hidden=(16,)).layers()[1]
    for values in (weight, bias):
        assert values.abs().max() <= 0.25
        assert values.std().item() == pytest.approx(0.25 / np.sqrt(3), rel=0.1)


def test_critics_follow_their_own_generators_and_leave_the_global_stream_alone():
    state = torch.get_rng_state()
    together, alone, other = networks((4, 5, 6)), networks((5,)), networks((7,))
    assert torch.equal(torch.get_rng_state(), state)
    pairs = list(zip(together.parameters(), alone.parameters(), other.parameters(), strict=True))
    assert all(torch.equal(a[1], b[0]) for a, b, _ in pairs)
    assert not any(torch.equal(b, c) for _, b, c in pairs)


def test_value_networks_count_features_and_values_from_their_means_in_their_spreads():
    """V(s) = m_V + d_V f((s - m_s) / d_s), each tree by its own."""
    stacked, observed = networks(hidden=(8,)), observation(3, 6, n_features=4)
    mean, spread = observation(3, n_features=4), observation(3, n_features=4).abs() + 0.1
    with torch.no_grad():
        plain = stacked(observed)
        stacked.standardise_features(mean, spread)
        moved = mean.unsqueeze(1) + spread.unsqueeze(1) * observed
        torch.testing.assert_close(stacked(moved), plain, atol=1e-5, rtol=1e-5)
        stacked.standardise_values(torch.tensor([-60.0, 0.0, 5.0]), torch.tensor([20.0, 1.0, 0.5]))
        expected = (
            torch.tensor([-60.0, 0.0, 5.0]).view(3, 1, 1)
            + torch.tensor([20.0, 1.0, 0.5]).view(3, 1, 1) * plain
        )
        torch.testing.assert_close(stacked(moved), expected, atol=1e-4, rtol=1e-5)


@pytest.mark.parametrize("dtype", [torch.float64, torch.int64])
def test_critics_read_observations_of_any_type(dtype):
    observed = torch.randint(-3, 3, (3, 5, 4), generator=torch.Generator().manual_seed(0))
    assert torch.equal(networks()(observed.to(dtype)), networks()(observed.float()))
