import numpy as np
import pytest

import ge_torchrl as ge
from ge_torchrl.trees.controller import Names
from ge_torchrl.trees.tree import DecisionTree

CARTPOLE = "docs/trees/cartpole_two_decisions.json"
FORCE = Names(
    "MountainCarContinuous-v0", ("position", "velocity"), ("m", "m/s"), ("force",), action_bounds=((-1, 1),)
)


@pytest.fixture
def controller(request):
    return ge.load(request.config.rootpath / CARTPOLE)


def test_it_is_saved_and_loaded(controller, tmp_path):
    controller.save(tmp_path / "tree.json")
    assert ge.load(tmp_path / "tree.json") == controller
    with pytest.raises(
        ge.UserError, match=r"expected a tree's file or a run's folder; there is none at .*absent\.json"
    ):
        ge.load(tmp_path / "absent.json")
    with pytest.raises(ge.UserError, match=r"nodes chooses a tree of a run"):
        ge.load(tmp_path / "tree.json", nodes=3)
    with pytest.raises(ge.UserError, match=r"must be the folder of one run, which holds best_tree\.json"):
        ge.load(tmp_path)
    controller.save(tmp_path / "new" / "folder" / "tree.json")
    assert ge.load(tmp_path / "new" / "folder" / "tree.json") == controller


@pytest.mark.parametrize(
    "observation", [[None] * 4, ["a"] * 4, [1, 2, 3], None, [[1, 2], [3]], {"a": 1}, [1j] * 4, [[1, 2, 3, 4]]]
)
def test_what_is_no_observation_is_refused_in_one_line(controller, observation):
    told = r"observed by 4 features, so expected as many numbers \(x, x_dot, theta, theta_dot\); got "
    with pytest.raises(ge.UserError, match=told) as raised:
        controller(observation)
    assert isinstance(raised.value, ValueError)
    assert "\n" not in str(raised.value)


def test_the_pair_that_reset_returns_is_recognised(controller):
    with pytest.raises(ge.UserError, match="the first is the observation"):
        controller(([0.0, 0.0, 0.0, 0.0], {}))


def test_it_shows_itself(controller):
    assert repr(controller).splitlines()[:2] == ["CartPole-v1, 2 decision nodes", "theta < -0.022 rad?"]
    assert controller._repr_markdown_() == f"```text\n{controller!r}\n```"
    assert controller.rules().count("if ") == 3


class TestPolicy:
    def test_it_runs_in_a_rollout(self, controller):
        from torchrl.envs import GymEnv

        for categorical in (False, True):
            environment = GymEnv("CartPole-v1", categorical_action_encoding=categorical)
            environment.set_seed(0)
            played = environment.rollout(60, controller.policy(categorical_action_encoding=categorical))
            assert len(played) == 60, "it balances"
            observations, actions = played["observation"].numpy(), played["action"]
            chosen = actions.numpy() if categorical else actions.argmax(-1).numpy()
            assert chosen.tolist() == [controller(observation) for observation in observations]
            environment.close()

    def test_it_answers_what_the_controller_answers_on_any_batch(self, controller):
        import torch
        from tensordict import TensorDict

        observations = torch.randn(3, 5, 4, generator=torch.Generator().manual_seed(0))
        observations[0, 0, 2] = float(controller.tree.threshold[0])
        played = controller.policy()(TensorDict({"observation": observations}, [3, 5]))
        assert played["action"].shape == (3, 5, 2)
        expected = controller.decide(observations.numpy().reshape(-1, 4)).reshape(3, 5)
        assert (played["action"].argmax(-1).numpy() == expected).all()
        with pytest.raises(ge.UserError, match="observed by 4 features"):
            controller.policy()(TensorDict({"observation": observations[..., :3]}, [3, 5]))

    def test_actions_that_are_numbers_are_clipped(self):
        from torchrl.envs import GymEnv

        controller = ge.Controller(DecisionTree.value_leaf([0.5], {1: [100.0]}), FORCE)
        environment = GymEnv("MountainCarContinuous-v0")
        environment.set_seed(0)
        played = environment.rollout(40, controller.policy())
        actions = played["action"].numpy()
        assert actions.dtype == np.float32
        assert np.array_equal(actions, [controller(one) for one in played["observation"].numpy()])
        assert actions.max() == 1.0
        environment.close()
