"""Trees are measured part by part: the same numbers as at once, told as they come, few returns in memory."""

import numpy as np
import pytest
from fake_backend import FakeBackend

from ge_torchrl.report import measuring
from ge_torchrl.report.measuring import Meter
from ge_torchrl.trees.tree import DecisionTree

TREES = [
    DecisionTree.split(0, threshold, DecisionTree.leaf(0), DecisionTree.leaf(1))
    for threshold in (1.0, 2.0, 3.0)
]
SEEDS = np.arange(70)


def value(tree):
    return float(tree.threshold[0])


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(measuring, "_PART", 8)
    monkeypatch.setattr(measuring, "_MOST_RETURNS", 140)


@pytest.mark.usefixtures("small")
def test_parts_give_what_all_at_once_gives_and_are_told():
    told = []
    found = Meter(FakeBackend(value, luck=5.0), 210, lambda *of: told.append(of)).returns(
        TREES, SEEDS, "test"
    )
    from ge_torchrl.trees.forest import Forest

    at_once = FakeBackend(value, luck=5.0).evaluate(Forest.stack(TREES), SEEDS, "test").returns
    assert found.tobytes() == at_once.tobytes()
    assert told == [(24, 210), (72, 210), (168, 210), (210, 210)]


@pytest.mark.usefixtures("small")
def test_few_trees_are_measured_at_a_time_and_all_are_counted():
    told = []
    meter = Meter(FakeBackend(value, luck=5.0), 210, lambda *of: told.append(of))
    means = meter.means(TREES, SEEDS, "test")
    whole = Meter(FakeBackend(value, luck=5.0), 210, measuring.tell_nobody).returns(TREES, SEEDS, "test")
    assert means == {tree: (of.mean(), of.std()) for tree, of in zip(TREES, whole, strict=True)}
    assert told[-1] == (210, 210)
    assert meter.means([], SEEDS, "test") == {}
