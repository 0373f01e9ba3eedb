"""How many copies of an environment live at once is known, and bounded where one is large."""

import gc
import weakref

import numpy as np
import pytest
from environments_for_tests import WalkEnv, register

from ge_torchrl.environments import instances
from ge_torchrl.environments.border import Border
from ge_torchrl.environments.instances import copies_that_fit
from ge_torchrl.environments.spec import describe
from ge_torchrl.environments.witness import Witness
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

MB = 1024**2
ALIVE = weakref.WeakSet()


class LargeEnv(WalkEnv):
    """Takes 40 MB, and knows who lives."""

    most_alive = 0

    def __init__(self):
        self.simulator = np.ones(40 * MB, np.uint8)
        ALIVE.add(self)
        gc.collect()
        type(self).most_alive = max(self.most_alive, len(ALIVE))


@pytest.fixture(autouse=True)
def forget(monkeypatch):
    monkeypatch.setattr(instances, "_measured", {})
    LargeEnv.most_alive = 0


def test_a_backend_has_one_copy_in_this_process(open_gymnasium):
    gc.collect()
    backend = open_gymnasium(LargeEnv)
    forest = Forest.stack([DecisionTree.leaf(0), DecisionTree.leaf(1)])
    backend.evaluate(forest, np.arange(20), "fitness")
    backend.observe(forest.trees(), 50, [np.random.default_rng(r) for r in range(2)], "refinement")
    backend.record(forest.trees()[0], 0)
    assert len(ALIVE) == LargeEnv.most_alive == 1
    backend.close()
    gc.collect()
    assert not ALIVE


def test_large_copies_are_few_and_small_ones_as_many_as_you_like():
    assert copies_that_fit(describe(register(LargeEnv))) == 32  # 51 of 40 MB are 2 GB.
    assert LargeEnv.most_alive == 2
    assert copies_that_fit(describe("CartPole-v1")) is None
    assert copies_that_fit(describe("Pendulum-v1")) is None


@pytest.mark.parametrize(
    ("size", "copies"),
    [(0, None), (8 * MB - 1, None), (8 * MB, 256), (100 * MB, 16), (1500 * MB, 1), (5000 * MB, 1)],
)
def test_all_together_take_two_gigabytes_at_most(size, copies):
    assert instances._fitting(size) == copies


def test_a_large_environment_is_measured_once(monkeypatch):
    described = describe(register(LargeEnv))
    copies_that_fit(described)
    monkeypatch.setattr(instances, "Border", None)
    assert copies_that_fit(described) == 32


def test_what_cannot_be_measured_is_not_bounded(monkeypatch, tmp_path):
    monkeypatch.setattr(instances, "_STATM", tmp_path / "nothing")
    assert copies_that_fit(describe(register(LargeEnv))) is None


def test_what_is_measured_is_closed():
    closed = []

    class CountingEnv(WalkEnv):
        def close(self):
            closed.append(self)

    described = describe(register(CountingEnv))
    closed.clear()
    copies_that_fit(described)
    assert len(closed) == 2


def test_a_closed_border_holds_no_simulator():
    border = Border(describe(register(LargeEnv)), Witness(describe(register(LargeEnv))))
    gc.collect()
    assert len(ALIVE) == 1
    border.close()
    border.close()
    gc.collect()
    assert not ALIVE
