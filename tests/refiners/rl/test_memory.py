"""PPO keeps few copies of a large environment."""

import weakref

import numpy as np
import pytest
from environments_for_tests import WalkEnv, register

from ge_torchrl.config import PPOConfig
from ge_torchrl.environments import instances
from ge_torchrl.environments.gymnasium_backend import GymnasiumBackend
from ge_torchrl.environments.spec import describe
from ge_torchrl.refiners.rl.refiner import PPORefiner
from ge_torchrl.trees.tree import DecisionTree

ALIVE = weakref.WeakSet()


class CountedEnv(WalkEnv):
    """Knows how many lived at once."""

    most_alive = 0

    def __init__(self):
        ALIVE.add(self)
        type(self).most_alive = max(self.most_alive, len(ALIVE))


@pytest.mark.parametrize(("copies", "trees_at_once"), [(16, 2), (1, 1), (None, 3)])
def test_no_more_trees_are_trained_together_than_there_is_room_for(monkeypatch, copies, trees_at_once):
    monkeypatch.setattr(instances, "copies_that_fit", lambda _: copies)
    backend = GymnasiumBackend(describe(register(CountedEnv)), workers=1)
    little = PPOConfig(max_timesteps=80, update_timesteps=40, epochs=1, snapshot_episodes=0)
    trees = [DecisionTree.split(0, float(t), DecisionTree.leaf(0), DecisionTree.leaf(1)) for t in range(3)]
    CountedEnv.most_alive = 0
    refined = PPORefiner(backend, little, "refinement").refine(
        trees, [np.random.default_rng(r) for r in range(3)]
    )
    # Beside those of the collector there is the backend's own.
    assert CountedEnv.most_alive == 8 * trees_at_once + 1
    assert [each.training.failure for each in refined] == [None] * 3
    backend.close()
