"""Trees -> DDT -> PPO -> trees, with little PPO."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from environments_for_tests import Int64WalkEnv, register

from ge_torchrl.config import PPOConfig
from ge_torchrl.environments.backend import Limit, LimitReachedError
from ge_torchrl.environments.gymnasium_backend import GymnasiumBackend
from ge_torchrl.environments.kernel_backend import KernelBackend
from ge_torchrl.environments.spec import describe
from ge_torchrl.refiners.protocol import Effort
from ge_torchrl.refiners.rl.refiner import PPORefiner
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
GOOD = split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1))
# The right questions with answers that are mostly wrong.
WRONG = split(2, 0.0154, split(3, 0.2290, leaf(1), leaf(1)), leaf(0))
FOREST = [WRONG, split(3, 0.0, leaf(1), leaf(0)), leaf(1), GOOD]
THESIS = PPOConfig(
    max_timesteps=600,
    update_timesteps=200,
    epochs=3,
    optimizer="rmsprop",
    lr_actor=0.001,
    lr_critic=0.001,
    gamma=0.95,
    gae_lambda=0.95,
    entropy_final=None,
    alpha=1000.0,
    leaf_logit=None,
    standardise=False,
    snapshot_episodes=0,
)
LITTLE = PPOConfig(max_timesteps=1200, update_timesteps=300, epochs=3, snapshot_episodes=5)


@pytest.fixture
def backend():
    backend = KernelBackend(describe("CartPole-v1"))
    yield backend
    backend.close()


def rngs(n, seed=0):
    return [np.random.default_rng([seed, row]) for row in range(n)]


def refined(backend, trees=FOREST, settings=LITTLE, seed=0, effort=Effort()):  # noqa: B008
    return PPORefiner(backend, settings, "refinement").refine(trees, rngs(len(trees), seed), effort)


def test_structure_is_kept_and_steps_are_counted(backend):
    for before, after in zip(FOREST, refined(backend), strict=True):
        assert after.tree.with_actions(before.action).structure == before.structure
        assert (after.training.timesteps, after.training.updates, after.training.gradient_steps) == (
            1200,
            3,
            9,
        )
        assert after.training.failure is None
    assert backend.steps["refinement"] > 4 * 1200
    assert set(backend.steps) == {"refinement"}


def test_the_same_generators_give_the_same_trees(backend):
    one, two, other = (refined(backend, seed=seed) for seed in (3, 3, 4))
    assert [r.tree for r in one] == [r.tree for r in two]
    assert [r.training for r in one] == [r.training for r in two]
    assert [r.training for r in one] != [r.training for r in other]


def test_threads_change_nothing():
    results = []
    for threads in (1, 2):
        backend = KernelBackend(describe("CartPole-v1"), threads)
        results.append(refined(backend))
        backend.close()
    assert results[0][0].training == results[1][0].training
    assert [r.tree for r in results[0]] == [r.tree for r in results[1]]


@pytest.mark.parametrize(
    "settings", [LITTLE, THESIS, replace(LITTLE, straight_through=True, minibatch_size=100)]
)
def test_a_tree_beside_others_is_refined_as_alone(backend, settings):
    """Law 9; of few steps, since rounding may at last decide an action."""
    settings = replace(settings, max_timesteps=2 * settings.update_timesteps)
    together = refined(backend, settings=settings)
    for row, tree in enumerate(FOREST):
        (alone,) = PPORefiner(backend, settings, "refinement").refine([tree], [rngs(4)[row]])
        np.testing.assert_allclose(alone.tree.parameters, together[row].tree.parameters, atol=1e-4)
        assert alone.training.actor_loss == pytest.approx(together[row].training.actor_loss, abs=1e-3)
        assert alone.training.soft_return == pytest.approx(together[row].training.soft_return, nan_ok=True)


def test_long_lists_are_refined_in_chunks(backend):
    trees = FOREST + FOREST[:1]
    chunked = refined(backend, trees, replace(LITTLE, trees_together=3))
    expected = []
    for first in (0, 3):
        part = slice(first, first + 3)
        expected += PPORefiner(backend, LITTLE, "refinement").refine(trees[part], rngs(5)[part])
    assert [r.tree for r in chunked] == [r.tree for r in expected]
    assert PPORefiner(backend, LITTLE, "refinement").refine([], []) == []


def mean_returns(backend, trees):
    return backend.evaluate(Forest.stack(trees), np.arange(10_000, 10_200), "test").returns.mean(1)


def test_a_training_that_only_harms_brings_back_the_tree_as_it_was(backend):
    harmful = replace(LITTLE, lr_actor=10.0, snapshot_episodes=0)
    (harmed,) = refined(backend, [GOOD], harmful)
    assert mean_returns(backend, [harmed.tree])[0] < 300
    (kept,) = refined(backend, [GOOD], replace(harmful, snapshot_episodes=50))
    assert kept.tree == GOOD


def test_snapshots_watch_and_do_not_disturb_the_training(backend):
    plain, watched = (refined(backend, settings=replace(LITTLE, snapshot_episodes=n)) for n in (0, 5))
    assert [r.training for r in plain] == [r.training for r in watched]


def test_effort_multiplies_steps_and_episodes(backend):
    (twice,) = refined(backend, [WRONG], effort=Effort(factor=2, patience=3))
    assert twice.training.timesteps == 6 * LITTLE.max_timesteps


def test_a_failed_training_keeps_the_tree(backend):
    (failed,) = refined(backend, [WRONG], replace(LITTLE, lr_critic=1e15))
    assert "is not finite in update" in failed.training.failure
    assert failed.tree == WRONG


def test_a_limit_ends_a_training(backend):
    backend.limit = Limit(max_env_steps=4000)
    with pytest.raises(LimitReachedError):
        refined(backend)


def test_a_sign_of_life_is_given_between_epochs(backend, monkeypatch):
    checks = []
    monkeypatch.setattr(backend.ledger, "check", lambda: checks.append(1))
    refined(backend, [WRONG], replace(LITTLE, snapshot_episodes=0))
    assert len(checks) >= 9


def test_gymnasium_is_refined_through_torchrl():
    backend = GymnasiumBackend(describe("CartPole-v1", max_episode_steps=50), 1)
    settings = replace(LITTLE, max_timesteps=400, update_timesteps=100, snapshot_episodes=1)
    together = refined(backend, FOREST[:2], settings)
    (alone,) = PPORefiner(backend, settings, "refinement").refine(FOREST[1:2], rngs(2)[1:])
    backend.close()
    assert [r.training.timesteps for r in together] == [400, 400]
    np.testing.assert_allclose(alone.tree.parameters, together[1].tree.parameters, atol=1e-3)


def test_observations_of_integers_are_refined():
    backend = GymnasiumBackend(describe(register(Int64WalkEnv, max_episode_steps=9)), 1)
    (done,) = refined(backend, [split(0, 1.0, leaf(0), leaf(1))], replace(LITTLE, max_timesteps=600))
    backend.close()
    assert done.training.failure is None


def test_learning_mends_what_is_wrong_for_most_seeds(backend):
    """A claim about learning: of eight wrong trees at least five end far better, whatever the processor."""
    settings = PPOConfig(max_timesteps=20_000, snapshot_episodes=20)
    trees = [WRONG] * 8
    before = mean_returns(backend, trees)
    after = mean_returns(backend, [r.tree for r in refined(backend, trees, settings)])
    assert before.max() < 50
    assert (after > 2 * before).sum() >= 5
    assert (after >= before - 1).all()


def test_learning_betters_most_mediocre_laws_of_a_pendulum():
    """A claim about learning: of ten trees with two linear laws at least eight end far better."""
    rng, value_leaf = np.random.default_rng(0), DecisionTree.value_leaf
    trees = [
        split(
            0,
            float(rng.uniform(0.3, 0.8)),
            value_leaf([0.0], {2: [float(rng.uniform(0.2, 0.5))]}),
            value_leaf([0.0], {1: [float(rng.uniform(-5, -3))], 2: [float(rng.uniform(-1.2, -0.8))]}),
        )
        for _ in range(10)
    ]
    backend = KernelBackend(describe("Pendulum-v1"), 1)
    settings = PPOConfig(max_timesteps=20_000, snapshot_episodes=20)
    refined = PPORefiner(backend, settings, "refinement").refine(trees, rngs(10))
    unseen = np.arange(900_000, 900_100)
    before, after = (
        backend.evaluate(Forest.stack(forest), unseen, "measuring").returns.mean(1)
        for forest in (trees, [result.tree for result in refined])
    )
    assert (after > before + 100).sum() >= 8
    backend.close()


def test_torch_is_left_as_it_was(backend):
    state, threads = torch.get_rng_state(), torch.get_num_threads()
    refined(backend)
    assert torch.equal(torch.get_rng_state(), state)
    assert torch.get_num_threads() == threads
