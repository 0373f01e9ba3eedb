"""Local search in a true environment: CartPole, by its kernel."""

from __future__ import annotations

import numpy as np
import pytest

from ge_torchrl.config import PolishConfig
from ge_torchrl.environments.kernel_backend import KernelBackend
from ge_torchrl.environments.spec import describe
from ge_torchrl.refiners.local_search import LocalSearch
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
WRONG_LEAVES = split(2, 0.0154, split(3, 0.2290, leaf(1), leaf(1)), leaf(0))
# The first question is asked far from where the pole stands.
FAR_THRESHOLD = split(2, 0.12, split(3, 0.2290, leaf(0), leaf(1)), leaf(1))
CONFIG = PolishConfig(max_timesteps=100_000, episodes=5, first_step=0.3)
SEEDS = episode_seeds("training", 100, stream(0, "a test"))


@pytest.fixture(scope="module", params=[1, 2])
def backend(request):
    backend = KernelBackend(describe("CartPole-v1"), threads=request.param)
    yield backend
    backend.close()


def refined(backend, trees, seed=0):
    streams = [stream(seed, f"tree {i}") for i in range(len(trees))]
    return [one.tree for one in LocalSearch(backend, CONFIG, "polish").refine(trees, streams)]


def mean_returns(backend, trees):
    return backend.evaluate(Forest.stack(trees), SEEDS, "test").returns.mean(axis=1)


def test_what_is_wrong_is_mended(backend):
    """A claim over seeds: of a tree with wrong leaves every search makes a far better one."""
    before, *after = mean_returns(
        backend, [WRONG_LEAVES, *(refined(backend, [WRONG_LEAVES], s)[0] for s in range(8))]
    )
    assert before < 20
    assert np.median(after) > 200
    assert min(after) > 3 * before


def test_trees_refined_together_on_threads_end_where_each_would_alone(backend):
    trees = [WRONG_LEAVES, FAR_THRESHOLD, leaf(0)]
    streams = [stream(0, f"tree {i}") for i in range(3)]
    together = LocalSearch(backend, CONFIG, "polish").refine(trees, streams)
    for i, tree in enumerate(trees):
        before = backend.steps["alone"]
        (alone,) = LocalSearch(backend, CONFIG, "alone").refine([tree], [stream(0, f"tree {i}")])
        assert alone.tree == together[i].tree
        assert alone.training.timesteps == together[i].training.timesteps
        assert backend.steps["alone"] - before == alone.training.timesteps
