"""NumPy's linear algebra has one thread while CMA-ES searches, and then as many as before."""

import numpy as np
import pytest
from fake_backend import FakeBackend
from threadpoolctl import ThreadpoolController

from ge_torchrl.config import PolishConfig
from ge_torchrl.refiners.local_search import LocalSearch
from ge_torchrl.refiners.one_thread import one_thread
from ge_torchrl.refiners.strategy import Strategy
from ge_torchrl.refiners.ties import Ties
from ge_torchrl.trees.tree import DecisionTree

LIBRARIES = ThreadpoolController().select(user_api="blas")
TREE = DecisionTree.split(0, 0.5, DecisionTree.leaf(0), DecisionTree.leaf(1))


def threads():
    return {library["num_threads"] for library in LIBRARIES.info()}


@pytest.fixture(autouse=True)
def two_threads():
    with LIBRARIES.limit(limits=2):
        yield


@pytest.fixture
def seen():
    """The threads that there are while trees are measured."""
    found = set()

    class Backend(FakeBackend):
        def evaluate(self, *arguments, **others):
            found.update(threads())
            return super().evaluate(*arguments, **others)

    return Backend(lambda tree: -abs(float(tree.threshold[0])), luck=1.0), found


def test_there_is_one_thread_and_then_as_many_as_before():
    with one_thread():
        with one_thread():
            assert threads() == {1}
        assert threads() == {1}
    assert threads() == {2}


def test_an_error_takes_the_limit_back():
    with pytest.raises(ZeroDivisionError), one_thread():
        1 / 0  # noqa: B018
    assert threads() == {2}


@pytest.mark.parametrize("n_trees", [1, 2])
def test_the_local_search_has_one(seen, n_trees):
    backend, found = seen
    search = LocalSearch(backend, PolishConfig(max_timesteps=200), "polish")
    search.refine([TREE] * n_trees, [np.random.default_rng(seed) for seed in range(n_trees)])
    assert (found, threads()) == ({1}, {2})


def test_the_strategy_has_one(seen):
    backend, found = seen
    strategy = Strategy(backend, TREE, Ties.none(1), np.ones(1), 0.5, "starts", np.random.default_rng(0))
    strategy.advance(200)
    assert (found, threads()) == ({1}, {2})
