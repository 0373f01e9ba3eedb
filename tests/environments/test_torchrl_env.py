"""TorchRL's GymEnv and the Gymnasium route agree exactly (law 5)."""

import numpy as np
import pytest
import torch
from strategies import observed_trees
from tensordict.nn import TensorDictModule

from ge_torchrl.environments.dynamics import DYNAMICS
from ge_torchrl.environments.gymnasium_route import GymnasiumRoute
from ge_torchrl.environments.spec import describe
from ge_torchrl.environments.torchrl_env import make_torchrl_env
from ge_torchrl.trees.forest import Forest


@pytest.mark.parametrize("environment_id", DYNAMICS)
def test_returns_are_equal(environment_id):
    spec = describe(environment_id)
    trees = observed_trees(environment_id, 2, seed=5)
    route = GymnasiumRoute(spec, workers=1)
    expected = route.evaluate(Forest.stack(trees), np.array([0, 21]))
    route.close()
    environment = make_torchrl_env(spec)
    for p, tree in enumerate(trees):
        policy = TensorDictModule(
            lambda observation, tree=tree: torch.from_numpy(tree.decide(observation.numpy()[None]))[0].long(),
            in_keys=["observation"],
            out_keys=["action"],
        )
        for e, seed in enumerate([0, 21]):
            rollout = environment.rollout(
                spec.max_episode_steps + 1, policy, auto_reset=False, tensordict=environment.reset(seed=seed)
            )
            assert rollout["next", "reward"].sum().item() == expected.returns[p, e]
            assert len(rollout) == expected.lengths[p, e]
            assert rollout["next", "done"][-1].item()
            truncated = rollout["next", "truncated"][-1].item()
            assert truncated == (expected.lengths[p, e] == spec.max_episode_steps)
    environment.close()
