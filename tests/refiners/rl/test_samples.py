"""Both sources give the same samples in all but chance."""

import math

import numpy as np
import pytest
import torch
from environments_for_tests import Int64WalkEnv, register
from soft_forests_for_tests import calibration, mixtures
from strategies import observed_trees

from ge_torchrl.environments.backend import Limit, LimitReachedError
from ge_torchrl.environments.gymnasium_backend import GymnasiumBackend
from ge_torchrl.environments.kernel_backend import KernelBackend
from ge_torchrl.environments.spec import describe
from ge_torchrl.refiners.rl import collecting
from ge_torchrl.refiners.rl.actor_critic import make_actor
from ge_torchrl.refiners.rl.collecting import CollectorSource
from ge_torchrl.refiners.rl.ddt import soften
from ge_torchrl.refiners.rl.distributions import GaussianMixture
from ge_torchrl.refiners.rl.gaussian import soften_values
from ge_torchrl.refiners.rl.samples import KernelSource, last_returns, open_source
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
BACKENDS = {"kernel": KernelBackend, "gymnasium": GymnasiumBackend}
LIMIT = 25
# It leans to where the pole falls, and takes sides: both the path and the leaf are left to chance.
BALANCING = split(2, 0.0, split(3, 0.5, leaf(0), leaf(1)), split(3, -0.5, leaf(0), leaf(1)))
WITH_THE_VELOCITY = split(1, 0.0, leaf(0), leaf(2))
FOREST = [BALANCING, leaf(1), split(2, 0.01, leaf(0), leaf(1))]


class Sampled:
    """Sources of soft trees and what they hold, closed at the end of a test."""

    def __init__(self):
        self.closers = []

    def __call__(
        self, name, trees, environment_id="CartPole-v1", limit=None, seeds=None, alpha=10.0, **options
    ):
        backend = BACKENDS[name](describe(environment_id, max_episode_steps=limit), 1)
        spec = backend.spec
        if spec.is_continuous:
            bounds = spec.action_low, spec.action_high
            ddt = soften_values(trees, spec.n_features, bounds, alpha=alpha, **options)
        else:
            ddt = soften(trees, spec.n_actions, alpha, 0, options.pop("leaf_logit", 1.0), **options)
        seeds = range(len(trees)) if seeds is None else seeds
        rngs = [np.random.default_rng([7, seed]) for seed in seeds]
        source = open_source(backend, ddt, make_actor(ddt), rngs, "refinement")
        self.closers += [source.close, backend.close]
        return source, ddt, backend


@pytest.fixture
def opened():
    sampled = Sampled()
    yield sampled
    for close in sampled.closers:
        close()


def flat(samples):
    """Samples [R, T], those of the copies of a tree one after another."""
    return samples.flatten(1) if samples.ndim == 2 else samples.flatten(1, 2)


def layout(samples):
    leaves = samples.items(include_nested=True, leaves_only=True)
    return {key: (tuple(value.shape), value.dtype) for key, value in leaves}


@pytest.mark.parametrize("environment_id", ["CartPole-v1", "MountainCar-v0", "Acrobot-v1"])
def test_both_have_one_layout_and_count_their_steps(opened, environment_id):
    layouts = []
    for name in BACKENDS:
        source, _, backend = opened(name, observed_trees(environment_id, 3, seed=5), environment_id, LIMIT)
        samples = source.collect(40)
        assert samples.batch_size == ((3, 40) if name == "kernel" else (3, 8, 5))
        layouts.append(layout(flat(samples)))
        assert backend.steps == {"refinement": 120}
    assert layouts[0] == layouts[1]
    assert layouts[0]["observation"][1] == torch.float32
    assert layouts[0]["action"] == ((3, 40), torch.int64)


@pytest.mark.parametrize("name", BACKENDS)
@pytest.mark.parametrize("straight_through", [False, True])
def test_log_probabilities_are_those_of_one_batched_forward_pass(opened, name, straight_through):
    source, ddt, _ = opened(name, FOREST, straight_through=straight_through)
    samples = source.collect(120)
    with torch.no_grad():
        expected = ddt(samples["observation"]).gather(-1, samples["action"].unsqueeze(-1)).squeeze(-1)
    assert samples["action_log_prob"].unique().numel() > 1
    torch.testing.assert_close(samples["action_log_prob"], expected, atol=1e-5, rtol=0)


SWINGING = [
    split(0, 0.5, DecisionTree.value_leaf([1.9], {2: [0.3]}), DecisionTree.value_leaf([0.0], {1: [-4.0]})),
    DecisionTree.value_leaf([0.2]),
    DecisionTree.weighted_split([0, 2], [1.0, 0.1], 0.2, *map(DecisionTree.value_leaf, ([-1.0], [1.0]))),
]


@pytest.mark.parametrize("name", BACKENDS)
@pytest.mark.parametrize("straight_through", [False, True])
def test_values_are_drawn_from_the_mixture_and_recorded_as_drawn(opened, name, straight_through):
    """What lies between a value and the mean of its mixture, in its deviations, has mean 0 and deviation 1."""
    source, ddt, backend = opened(name, SWINGING, "Pendulum-v1", straight_through=straight_through)
    samples = flat(source.collect(1600))
    assert layout(samples)["action"] == ((3, 1600, 1), torch.float32)
    assert backend.steps == {"refinement": 4800}
    with torch.no_grad():
        weights, answers, log_sd = ddt(samples["observation"])
        expected = GaussianMixture(weights, answers, log_sd).log_prob(samples["action"])
    torch.testing.assert_close(samples["action_log_prob"], expected, atol=1e-4, rtol=0)
    mean = (weights.unsqueeze(-1) * answers).sum(-2)
    variance = (weights.unsqueeze(-1) * (answers - mean.unsqueeze(-2)).square()).sum(-2) + (2 * log_sd).exp()
    normal = ((samples["action"] - mean) / variance.sqrt()).squeeze(-1).double()
    assert (normal.mean(1).abs() < 4.5 / math.sqrt(1600)).all()
    assert ((normal.square().mean(1) - 1).abs() < 4.5 * math.sqrt(2 / 1600)).all()
    assert (samples["action"].abs() > 2).any(), "not cut"


def test_values_of_a_tree_follow_from_its_generator_alone(opened):
    together = opened("gymnasium", SWINGING, "Pendulum-v1")[0].collect(80)
    alone = opened("gymnasium", SWINGING[2:], "Pendulum-v1", seeds=[2])[0].collect(80)
    torch.testing.assert_close(alone["action"][0], together["action"][2], atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("name", BACKENDS)
def test_streams_go_on_from_batch_to_batch(opened, name):
    source, _, _ = opened(name, FOREST, limit=LIMIT)
    batches = torch.cat([source.collect(60) for _ in range(4)], -1)
    after = batches["next"]
    done = after["done"].squeeze(-1)
    goes_on = ~done[..., :-1]
    assert torch.equal(
        after["observation"][..., :-1, :][goes_on], batches["observation"][..., 1:, :][goes_on]
    )
    assert torch.equal(after["done"], after["terminated"] | after["truncated"])
    assert after["truncated"].any()
    # Every reward is 1: an episode's return is its length.
    for stream in batches.reshape(-1, batches.shape[-1]):
        ends = torch.nonzero(stream["next", "done"].squeeze(-1)).squeeze(-1)
        lengths = torch.diff(ends, prepend=torch.tensor([-1]))
        assert stream["next", "episode_reward"][ends, 0].tolist() == lengths.tolist()
        assert torch.equal(stream["next", "truncated"].squeeze(-1)[ends], lengths == LIMIT)


@pytest.mark.parametrize("name", BACKENDS)
def test_a_trees_generator_decides_everything_and_its_neighbours_nothing(opened, name):
    state = torch.get_rng_state()
    together = opened(name, FOREST)[0].collect(80)
    for row in (0, 2):
        alone = opened(name, [FOREST[row]], seeds=[row])[0].collect(80)[0]
        assert torch.equal(alone["action"], together[row]["action"])
        assert torch.equal(alone["observation"], together[row]["observation"])
    other = opened(name, [FOREST[0]], seeds=[5])[0].collect(80)[0]
    assert not torch.equal(other["observation"], together[0]["observation"])
    assert torch.equal(torch.get_rng_state(), state)


@pytest.mark.parametrize("name", BACKENDS)
def test_samples_follow_the_trees_as_they_stand(opened, name):
    source, ddt, _ = opened(name, [leaf(0), leaf(0)], leaf_logit=100.0)
    assert not source.collect(40)["action"].any()
    with torch.no_grad():
        ddt.leaf_logits[1, 0] = torch.tensor([0.0, 100.0])
    after = source.collect(40)["action"].flatten(1)
    assert not after[0].any()
    assert after[1].all()


@pytest.mark.parametrize("name", BACKENDS)
def test_samples_of_standardised_trees_agree_with_their_probabilities(opened, name):
    source, ddt, _ = opened(name, [BALANCING] * 10, limit=LIMIT, leaf_logit=3.0, alpha=2.0)
    blunt = source.collect(160)
    ddt.standardise(torch.tensor([[1.0, 1.0, 0.05, 0.5]]).expand(10, -1))
    samples, soft = source.collect(160), ddt.soft_forest()

    def misfit(samples):
        observed = samples["observation"].reshape(-1, 4).numpy()
        return calibration(observed, samples["action"].flatten().numpy(), mixtures(soft, 0, observed))

    assert misfit(samples) < 4.5
    assert misfit(blunt) > 5, "the samples before are those of another policy"


def ks_p_value(first, second):
    """The asymptotic p-value of the two-sample Kolmogorov-Smirnov test (Stephens' correction)."""
    n, m = len(first), len(second)
    values = np.concatenate([first, second])
    cumulated = [
        np.searchsorted(np.sort(sample), values, "right") / len(sample) for sample in (first, second)
    ]
    root = math.sqrt(n * m / (n + m))
    scaled = (root + 0.12 + 0.11 / root) * np.abs(cumulated[0] - cumulated[1]).max()
    terms = [(-1) ** (k - 1) * math.exp(-2 * (k * scaled) ** 2) for k in range(1, 101)]
    return min(1.0, max(0.0, 2 * sum(terms))) if scaled > 0.2 else 1.0


def finished_returns(samples):
    return samples["next", "episode_reward"][samples["next", "done"]].double().numpy()


def last_positions(samples):
    return samples["next", "observation"][samples["next", "done"].squeeze(-1)][:, 0].double().numpy()


@pytest.mark.parametrize(
    ("environment_id", "limit", "tree", "other_tree", "alpha", "statistic"),
    [
        ("CartPole-v1", 50, BALANCING, leaf(0), 10.0, finished_returns),
        # Within this limit no episode reaches the goal and all returns are equal: compare where they end.
        ("MountainCar-v0", 35, WITH_THE_VELOCITY, leaf(1), 200.0, last_positions),
    ],
)
def test_both_draw_from_one_distribution_and_another_tree_is_told_apart(
    opened, environment_id, limit, tree, other_tree, alpha, statistic
):
    def ends(name, tree, n_steps):
        return statistic(opened(name, [tree] * 10, environment_id, limit, alpha=alpha)[0].collect(n_steps))

    collected = ends("gymnasium", tree, 1600)
    assert len(collected) > 80
    assert ks_p_value(collected, ends("kernel", tree, 10_000)) > 1e-3
    assert ks_p_value(collected, ends("kernel", other_tree, 10_000)) < 1e-4


def test_the_test_of_distributions_holds_its_level():
    rng = np.random.default_rng(0)
    p_values = [ks_p_value(rng.normal(size=100), rng.normal(size=1000)) for _ in range(400)]
    assert 0.02 < np.mean(np.array(p_values) < 0.05) < 0.09
    assert ks_p_value(rng.normal(size=100), rng.normal(1.0, size=1000)) < 1e-6


def test_kernels_are_sampled_where_there_are_any(opened):
    assert isinstance(opened("kernel", FOREST)[0], KernelSource)
    assert isinstance(opened("gymnasium", FOREST)[0], CollectorSource)


def test_processes_that_sample_are_told(opened):
    source, _, backend = opened("gymnasium", FOREST)
    assert backend.sampling_processes == 0
    source.collect(16)
    # As many as were asked for.
    assert backend.sampling_processes == backend.workers == 1
    source, _, backend = opened("kernel", FOREST)
    source.collect(16)
    assert backend.sampling_processes == 0


def test_collecting_in_pieces_changes_nothing(opened, monkeypatch):
    whole = opened("gymnasium", FOREST)[0].collect(80)
    monkeypatch.setattr(collecting, "_PIECE_STEPS", 30)
    pieces = opened("gymnasium", FOREST)[0].collect(80)
    assert (whole == pieces).all()


def test_a_limit_holds_between_pieces(opened, monkeypatch):
    monkeypatch.setattr(collecting, "_PIECE_STEPS", 24)
    source, _, backend = opened("gymnasium", FOREST)
    backend.limit = Limit(max_env_steps=50)
    with pytest.raises(LimitReachedError):
        source.collect(400)
    assert backend.steps.total() == 72


def test_a_number_of_steps_that_copies_cannot_share_is_taken_by_fewer(opened):
    assert opened("gymnasium", FOREST)[0].collect(18).batch_size == (3, 2, 9)
    assert opened("gymnasium", FOREST)[0].collect(7).batch_size == (3, 1, 7)


def test_observations_of_integers_are_collected(opened):
    walk = register(Int64WalkEnv, max_episode_steps=9)
    samples = opened("gymnasium", [leaf(0), split(0, 1.0, leaf(0), leaf(1))], walk)[0].collect(40)
    assert samples["observation"].dtype == torch.float32


def test_last_returns_are_means_of_the_episodes_that_ended(opened):
    samples = opened("kernel", FOREST, limit=LIMIT)[0].collect(200)
    for row, mean in enumerate(last_returns(samples)):
        assert mean == pytest.approx(finished_returns(samples[row]).mean())
    assert np.isnan(last_returns(opened("kernel", FOREST)[0].collect(3))).all()
