"""TorchRL sees what the Gymnasium backend sees, copy by copy (law 5)."""

import multiprocessing
import os

import faulty_environments as faulty
import numpy as np
import pytest
import torch
from environments_for_tests import FromOneEnv, Int64WalkEnv, UInt8WalkEnv, WalkEnv, register
from tensordict.nn import TensorDictModule
from torchrl.collectors import Collector
from torchrl.envs.utils import check_env_specs

from ge_torchrl.environments import vector_env
from ge_torchrl.environments.gymnasium_backend import GymnasiumBackend
from ge_torchrl.environments.spec import describe
from ge_torchrl.environments.torchrl_env import make_torchrl_env
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
TREES = {
    "CartPole-v1": split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1)),
    "MountainCar-v0": split(1, -0.0005, split(0, -1.0361, leaf(2), leaf(0)), leaf(2)),
    "LunarLander-v3": split(4, -0.07, leaf(1), split(3, -0.3, leaf(2), leaf(3))),
    "Pendulum-v1": split(
        0,
        0.8,
        DecisionTree.value_leaf([0.0], {2: [0.4]}),
        DecisionTree.value_leaf([0.1], {1: [-9.0], 2: [-1.7]}),
    ),
}


def policy_of(tree):
    return TensorDictModule(
        lambda observation: torch.from_numpy(tree.decide(observation.numpy())).to(
            torch.int64 if tree.has_actions else torch.float32
        ),
        in_keys=["observation"],
        out_keys=["action"],
    )


def collected(environment, tree, n_steps):
    """Return the samples [n, T] of a tree under TorchRL's collector."""
    collector = Collector(
        environment,
        policy_of(tree),
        frames_per_batch=n_steps * environment.batch_size[0],
        total_frames=-1,
        track_traj_ids=False,
        auto_register_policy_transforms=False,
    )
    samples = collector.next().clone()
    collector.shutdown()
    return samples


def rngs_of(n):
    return [np.random.default_rng(10 + i) for i in range(n)]


@pytest.mark.parametrize(
    ("environment_id", "n_steps"),
    [("CartPole-v1", 1100), ("MountainCar-v0", 450), ("LunarLander-v3", 420), ("Pendulum-v1", 450)],
)
def test_episodes_are_those_of_the_backend(environment_id, n_steps):
    if environment_id == "LunarLander-v3":
        pytest.importorskip("Box2D")
    spec, tree = describe(environment_id), TREES[environment_id]
    samples = collected(make_torchrl_env(spec, 2, rngs_of(2), workers=1), tree, n_steps)
    assert samples.batch_size == (2, n_steps)
    backend = GymnasiumBackend(spec, workers=1)
    for i, rng in enumerate(rngs_of(2)):
        ends = torch.nonzero(samples[i]["next", "done"].squeeze(-1)).squeeze(-1).tolist()
        assert len(ends) >= 2
        for first, end in zip([0, *(end + 1 for end in ends)], ends, strict=False):
            seed = int(episode_seeds("training", 1, rng)[0])
            ours, theirs = samples[i, first : end + 1], backend.record(tree, seed)
            np.testing.assert_array_equal(ours["observation"], theirs.observations[:-1])
            np.testing.assert_array_equal(ours["next", "observation"], theirs.observations[1:])
            cut = ours["action"].clamp(-2, 2) if spec.is_continuous else ours["action"]
            np.testing.assert_array_equal(cut, theirs.actions)
            np.testing.assert_allclose(ours["next", "reward"].squeeze(-1), theirs.rewards, rtol=1e-6)
            assert ours["next", "episode_reward"][-1].item() == pytest.approx(theirs.rewards.sum(), rel=1e-4)
            flags = [ours["next", flag][-1].item() for flag in ("terminated", "truncated")]
            assert flags == [theirs.terminated, theirs.truncated]
    backend.close()


@pytest.mark.parametrize("kind", [Int64WalkEnv, UInt8WalkEnv, FromOneEnv, faulty.WideEnv, faulty.InfiniteEnv])
def test_any_type_any_first_action_and_untrue_bounds(kind):
    spec = describe(register(kind))
    environment = make_torchrl_env(spec, 3, workers=1)
    assert environment.observation_spec["observation"].dtype == torch.float32
    tree = split(0, 5.5 if kind is UInt8WalkEnv else 0.5, leaf(1), leaf(0))
    samples = collected(environment, tree, 60)
    assert samples["observation"].dtype == torch.float32
    assert set(samples["action"].unique().tolist()) == {0, 1}
    backend = GymnasiumBackend(spec, workers=1)
    seed = int(episode_seeds("training", 1, np.random.default_rng([0, 1]))[0])
    expected = backend.record(tree, seed).rewards[:60]
    np.testing.assert_array_equal(samples["next", "reward"][1, : len(expected), 0], expected)
    backend.close()


@pytest.mark.parametrize("environment_id", ["CartPole-v1", "Pendulum-v1"])
def test_it_keeps_torchrls_own_rules(environment_id):
    environment = make_torchrl_env(describe(environment_id), 4, workers=1)
    check_env_specs(environment)
    environment.close()


@pytest.mark.parametrize("environment_id", [None, "Pendulum-v1"])
def test_a_copy_does_the_same_in_any_company_and_in_any_process(environment_id):
    spec, tree = (
        describe(environment_id or register(WalkEnv)),
        TREES.get(environment_id, split(0, 0.5, leaf(1), leaf(0))),
    )
    alone = [collected(make_torchrl_env(spec, 1, [rng], workers=1), tree, 80)[0] for rng in rngs_of(5)]
    for workers in (1, 2):
        together = collected(make_torchrl_env(spec, 5, rngs_of(5), workers=workers), tree, 80)
        for key in ("observation", ("next", "observation"), ("next", "reward"), ("next", "done")):
            assert torch.equal(together[key], torch.stack([samples[key] for samples in alone]))


def test_a_seed_begins_all_streams_anew():
    environment = make_torchrl_env(describe("CartPole-v1"), 3, workers=1)
    first = []
    for _ in range(2):
        environment.set_seed(7)
        first.append(environment.reset()["observation"])
    assert torch.equal(*first)
    assert not torch.equal(first[0], environment.reset()["observation"])
    assert len(first[0][:, 0].unique()) == 3
    environment.close()


def test_the_limit_truncates_and_does_not_terminate():
    environment = make_torchrl_env(describe("MountainCar-v0", max_episode_steps=9), 2, workers=1)
    samples = collected(environment, leaf(1), 27)["next"]
    expected = [(t + 1) % 9 == 0 for t in range(27)]
    for lane in range(2):
        assert samples["truncated"][lane].squeeze(-1).tolist() == expected
    assert not samples["terminated"].any()


@pytest.mark.parametrize("workers", [1, 2])
def test_faults_are_one_line_wherever_they_happen(workers):
    environment = make_torchrl_env(describe(register(faulty.NaNEnv)), 2, workers=workers)
    with pytest.raises(EnvironmentFaultError, match=r"NaN.*; episode seed \d+, step 1, action 0") as caught:
        collected(environment, leaf(0), 10)
    assert "\n" not in str(caught.value)
    environment.close()


def test_a_process_that_dies_is_one_line(monkeypatch):
    monkeypatch.setenv("TEST_ENVIRONMENT_LIVES_IN", str(os.getpid()))
    environment = make_torchrl_env(describe(register(faulty.DyingEnv)), 2, workers=2)
    with pytest.raises(EnvironmentFaultError, match=r"worker process.*died.*env\.workers=1"):
        collected(environment, leaf(0), 3)
    environment.close()


@pytest.mark.parametrize(("workers", "processes"), [(1, 1), (2, 2), (0, 3), (9, 6)])
def test_processes_are_as_many_as_asked_or_as_cores_where_they_pay(monkeypatch, workers, processes):
    monkeypatch.setattr(vector_env, "available_cores", lambda: 3)
    before = len(multiprocessing.active_children())
    environment = make_torchrl_env(describe(register(faulty.SlowStepEnv)), 6, workers=workers)
    assert environment.processes == processes
    assert len(multiprocessing.active_children()) - before == processes - 1
    environment.close()


def test_processes_are_started_where_steps_are_dear(monkeypatch):
    monkeypatch.setattr(vector_env, "available_cores", lambda: 4)
    cheap, dear = describe(register(WalkEnv)), describe(register(faulty.SlowStepEnv))
    assert vector_env._paying_processes(cheap, 16) == 1
    assert vector_env._paying_processes(dear, 16) == 4
    assert vector_env._paying_processes(dear, 1) > 1

    class LocalEnv(faulty.SlowStepEnv):
        """Cannot be sent to another process."""

    assert vector_env._paying_processes(describe(register(LocalEnv)), 16) == 1
