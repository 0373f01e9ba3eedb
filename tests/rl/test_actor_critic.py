import torch
from tensordict import TensorDict

from ge_torchrl.rl.actor_critic import ddt_of, make_actor_critic, value_network_of
from ge_torchrl.rl.ddt import soften
from ge_torchrl.trees.decision_tree import DecisionTree

TREE = DecisionTree.split(1, 0.25, DecisionTree.leaf(2), DecisionTree.leaf(0))


def build(seed=0, hidden=(64, 64)):
    return make_actor_critic(
        soften(TREE, 3, leaf_sd=0), 4, hidden, generator=torch.Generator().manual_seed(seed)
    )


def test_actor_writes_an_integer_action_and_the_trees_own_log_probability():
    actor, _ = build()
    observation = torch.randn(6, 4, generator=torch.Generator().manual_seed(0))
    with torch.random.fork_rng(devices=[]), torch.no_grad():
        output = actor(TensorDict({"observation": observation}, [6]))
        expected = ddt_of(actor)(observation)
    assert output["action"].dtype == torch.int64
    chosen = expected.gather(1, output["action"].unsqueeze(1)).squeeze(1)
    torch.testing.assert_close(output["action_log_prob"], chosen)


def test_actor_shares_the_trees_parameters():
    ddt = soften(TREE, 3, leaf_sd=0)
    actor, _ = make_actor_critic(ddt, 4, generator=torch.Generator().manual_seed(0))
    assert ddt_of(actor) is ddt
    assert {id(p) for p in actor.parameters()} == {id(p) for p in ddt.parameters()}


def test_critic_is_a_relu_network_of_the_hidden_widths():
    _, critic = build(hidden=(5, 7))
    assert [tuple(p.shape) for p in critic.parameters()] == [(5, 4), (5,), (7, 5), (7,), (1, 7), (1,)]
    assert sum(isinstance(module, torch.nn.ReLU) for module in critic.modules()) == 2
    output = critic(TensorDict({"observation": torch.ones(6, 4)}, [6]))
    assert output["state_value"].shape == (6, 1)


def test_a_value_network_counts_features_and_values_from_their_means_in_their_spreads():
    """V(s) = m_V + d_V f((s - m_s) / d_s)."""
    _, critic = build(hidden=(8,))
    network = value_network_of(critic)
    observation = torch.randn(6, 4, generator=torch.Generator().manual_seed(0))
    mean, spread = torch.tensor([1.0, -2.0, 0.5, 0.0]), torch.tensor([2.0, 0.05, 1.0, 4.0])
    with torch.no_grad():
        plain = network(observation)
        assert torch.equal(plain, network.network(observation)), "before that it is the network itself"
        network.standardise_features(mean, spread)
        torch.testing.assert_close(network(mean + spread * observation), plain)
        network.standardise_values(torch.tensor([-60.0]), torch.tensor([20.0]))
        torch.testing.assert_close(network(mean + spread * observation), -60 + 20 * plain)


def test_critic_follows_the_generator_and_leaves_the_global_stream_alone():
    state = torch.get_rng_state()
    (_, first), (_, same), (_, other) = (build(seed) for seed in (1, 1, 2))
    assert torch.equal(torch.get_rng_state(), state)
    pairs = list(zip(first.parameters(), same.parameters(), other.parameters(), strict=True))
    assert all(torch.equal(a, b) for a, b, _ in pairs)
    assert not any(torch.equal(a, c) for a, _, c in pairs)
