"""Both sources give the same samples in all but chance."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from soft_trees_for_tests import calibration
from strategies import observed_trees

from ge_torchrl.environments.dynamics import DYNAMICS
from ge_torchrl.environments.spec import describe
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.rl.actor_critic import ddt_of, make_actor_critic
from ge_torchrl.rl.ddt import soften
from ge_torchrl.rl.samples import CollectorSource, FusedSource, finished_returns, open_source
from ge_torchrl.trees.decision_tree import DecisionTree

SOURCES = ["collector", "fused"]
LIMIT = 25
# With these a tree takes sides, and both the path and the leaf are left to chance.
ALPHA, LEAF_SCALE = 10.0, 0.8
BALANCING = DecisionTree.split(
    2,
    0.0,
    DecisionTree.split(3, 0.5, DecisionTree.leaf(0), DecisionTree.leaf(1)),
    DecisionTree.split(3, -0.5, DecisionTree.leaf(0), DecisionTree.leaf(1)),
)
WITH_THE_VELOCITY = DecisionTree.split(1, 0.0, DecisionTree.leaf(0), DecisionTree.leaf(2))


def actor_of(tree, spec, leaf_scale=LEAF_SCALE, alpha=ALPHA):
    ddt = soften(tree, spec.n_actions, alpha=alpha, leaf_sd=0, leaf_scale=leaf_scale)
    return make_actor_critic(ddt, spec.n_features, generator=torch.Generator().manual_seed(0))[0]


def random_actor(spec):
    return actor_of(observed_trees(spec.id, 1, seed=5)[0], spec)


def collect(spec, source, actor, n_frames, seed=0):
    opened = open_source(spec, source, rng=np.random.default_rng(seed))
    samples = opened.collect(actor, n_frames)
    opened.close()
    return samples


def layout(samples):
    return {
        key: (tuple(value.shape), value.dtype)
        for key, value in samples.items(include_nested=True, leaves_only=True)
    }


def ks_p_value(first, second):
    """Return the asymptotic p-value of the two-sample Kolmogorov-Smirnov test (Stephens' correction)."""
    n, m = len(first), len(second)
    values = np.concatenate([first, second])
    cumulated = [
        np.searchsorted(np.sort(sample), values, "right") / len(sample) for sample in (first, second)
    ]
    root = math.sqrt(n * m / (n + m))
    scaled = (root + 0.12 + 0.11 / root) * np.abs(cumulated[0] - cumulated[1]).max()
    terms = [(-1) ** (k - 1) * math.exp(-2 * (k * scaled) ** 2) for k in range(1, 101)]
    return min(1.0, max(0.0, 2 * sum(terms))) if scaled > 0.2 else 1.0


@pytest.mark.parametrize("environment_id", DYNAMICS)
def test_both_have_one_layout(environment_id):
    spec = describe(environment_id, max_episode_steps=LIMIT)
    collected, fused = (collect(spec, source, random_actor(spec), 40) for source in SOURCES)
    assert layout(collected) == layout(fused)
    assert collected.batch_size == fused.batch_size == (40,)
    assert not any(samples[key].any() for samples in (collected, fused) for key in ("done", "terminated"))


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("environment_id", DYNAMICS)
def test_log_probabilities_are_those_of_one_batched_forward_pass(environment_id, source):
    spec = describe(environment_id)
    actor = random_actor(spec)
    samples = collect(spec, source, actor, 120)
    with torch.no_grad():
        expected = ddt_of(actor)(samples["observation"]).gather(1, samples["action"].unsqueeze(1)).squeeze(1)
    assert samples["action_log_prob"].unique().numel() > 1
    torch.testing.assert_close(samples["action_log_prob"], expected, atol=1e-5, rtol=0)


@pytest.mark.parametrize("source", SOURCES)
def test_a_stream_goes_on_from_batch_to_batch(source):
    spec = describe("CartPole-v1", max_episode_steps=LIMIT)
    actor = actor_of(BALANCING, spec)
    opened = open_source(spec, source, rng=np.random.default_rng(0))
    batches = torch.cat([opened.collect(actor, 61) for _ in range(4)])
    opened.close()
    after = batches["next"]
    done = after["done"].squeeze(-1)
    goes_on = ~done[:-1]
    assert torch.equal(after["observation"][:-1][goes_on], batches["observation"][1:][goes_on])
    assert torch.equal(after["done"], after["terminated"] | after["truncated"])
    assert after["truncated"].any()
    # Every reward is 1: an episode's return is its length.
    ends = torch.nonzero(done).squeeze(-1)
    lengths = torch.diff(ends, prepend=torch.tensor([-1]))
    assert finished_returns(batches).tolist() == lengths.tolist()
    assert torch.equal(after["truncated"].squeeze(-1)[ends], lengths == LIMIT)


@pytest.mark.parametrize("source", SOURCES)
def test_the_generator_decides_everything(source):
    spec = describe("CartPole-v1")
    actor = actor_of(BALANCING, spec)
    state = torch.get_rng_state()
    first, same, other = (collect(spec, source, actor, 150, seed) for seed in (1, 1, 2))
    assert torch.equal(torch.get_rng_state(), state)
    assert (first == same).all()
    assert not torch.equal(first["observation"], other["observation"])
    assert not torch.equal(first["action"], other["action"])


@pytest.mark.parametrize("source", SOURCES)
def test_samples_follow_the_actor_as_it_stands(source):
    spec = describe("CartPole-v1")
    actor = actor_of(DecisionTree.leaf(0), spec, leaf_scale=100)
    opened = open_source(spec, source, rng=np.random.default_rng(0))
    before = opened.collect(actor, 50)["action"]
    with torch.no_grad():
        ddt_of(actor).leaf_logits.copy_(torch.tensor([[0.0, 100.0]]))
    after = opened.collect(actor, 50)["action"]
    opened.close()
    assert not before.any()
    assert after.all()


def test_a_collector_takes_another_actor_or_number_of_frames():
    spec = describe("CartPole-v1")
    opened = open_source(spec, "collector", rng=np.random.default_rng(0))
    left, right = (actor_of(DecisionTree.leaf(action), spec, leaf_scale=100) for action in (0, 1))
    assert not opened.collect(left, 20)["action"].any()
    assert opened.collect(right, 20)["action"].all()
    assert len(opened.collect(right, 30)) == 30
    opened.close()
    opened.close()


def last_positions(samples):
    return samples["next", "observation"][samples["next", "done"].squeeze(-1), 0].double().numpy()


@pytest.mark.parametrize(
    ("environment_id", "limit", "tree", "other_tree", "alpha", "statistic"),
    [
        ("CartPole-v1", 50, BALANCING, DecisionTree.leaf(0), 10.0, finished_returns),
        # Within this limit no episode reaches the goal and all returns are equal: compare where they end.
        ("MountainCar-v0", 35, WITH_THE_VELOCITY, DecisionTree.leaf(1), 200.0, last_positions),
    ],
)
def test_both_draw_from_one_distribution_and_another_tree_is_told_apart(
    environment_id, limit, tree, other_tree, alpha, statistic
):
    spec = describe(environment_id, max_episode_steps=limit)
    actor, other_actor = (actor_of(which, spec, alpha=alpha) for which in (tree, other_tree))
    collected = statistic(collect(spec, "collector", actor, 3500))
    assert len(collected) > 80
    assert ks_p_value(collected, statistic(collect(spec, "fused", actor, 100_000))) > 0.01
    assert ks_p_value(collected, statistic(collect(spec, "fused", other_actor, 100_000))) < 1e-4


def test_the_test_of_distributions_holds_its_level():
    rng = np.random.default_rng(0)
    p_values = [ks_p_value(rng.normal(size=100), rng.normal(size=1000)) for _ in range(400)]
    assert 0.02 < np.mean(np.array(p_values) < 0.05) < 0.09
    assert ks_p_value(rng.normal(size=100), rng.normal(1.0, size=1000)) < 1e-6


def test_auto_is_fused_where_there_are_kernels():
    spec = describe("CartPole-v1")
    assert isinstance(open_source(spec, rng=np.random.default_rng(0)), FusedSource)
    unheard = replace(spec, id="Unheard-v0")
    assert isinstance(open_source(unheard, rng=np.random.default_rng(0)), CollectorSource)
    with pytest.raises(EnvironmentFaultError, match="compiled dynamics"):
        open_source(unheard, "fused", rng=np.random.default_rng(0))
    with pytest.raises(ValueError, match="source must be"):
        open_source(spec, "gym", rng=np.random.default_rng(0))


def test_actions_that_do_not_count_from_0_are_refused():
    spec = replace(describe("CartPole-v1"), first_action=5)
    with pytest.raises(EnvironmentFaultError, match="start at 5"):
        open_source(spec, "collector", rng=np.random.default_rng(0))


@pytest.mark.parametrize("source", SOURCES)
def test_samples_of_a_standardised_tree_agree_with_its_log_probabilities(source):
    spec = describe("CartPole-v1", max_episode_steps=LIMIT)
    actor = actor_of(BALANCING, spec, leaf_scale=3.0, alpha=2.0)
    blunt = collect(spec, source, actor, 1500)
    ddt_of(actor).standardise(torch.tensor([1.0, 1.0, 0.05, 0.5]))
    samples = collect(spec, source, actor, 1500)

    def misfit(samples):
        with torch.no_grad():
            probabilities = ddt_of(actor)(samples["observation"]).double().exp().numpy()
        return calibration(samples["observation"].double().numpy(), samples["action"].numpy(), probabilities)

    assert misfit(samples) < 4
    assert misfit(blunt) > 5, "the samples before are those of another policy"
