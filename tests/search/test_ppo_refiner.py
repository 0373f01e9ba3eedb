"""Tree -> DDT -> PPO -> tree, with little PPO."""

from dataclasses import asdict, fields, replace

import numpy as np
import pytest

from ge_torchrl.environments.choose import open_route
from ge_torchrl.environments.spec import describe
from ge_torchrl.records import TrainingRecord
from ge_torchrl.refiner_section import PPOConfig, RefinerConfig
from ge_torchrl.search import ppo_refiner
from ge_torchrl.search.ppo_refiner import PPORefiner, Snapshots
from ge_torchrl.search.refinement import FAILED, IMPROVED, NOT_IMPROVED, Effort, refine, stream_name
from ge_torchrl.trees.decision_tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
# The right questions with answers that are mostly wrong.
WRONG = split(2, 0.0154, split(3, 0.2290, leaf(1), leaf(1)), leaf(0))
LITTLE = PPOConfig(max_timesteps=600, update_timesteps=200, epochs=3)


def refined_by(route, config, tree=WRONG, *, seed, generation=40, attempt=0):
    name = stream_name(generation, attempt)
    measured = RefinerConfig(name="little", measuring_episodes=10)
    return refine(PPORefiner(route, config), route, tree, measured, seed, name)


@pytest.fixture(scope="module")
def route():
    route = open_route(describe("CartPole-v1"))
    yield route
    route.close()


def test_structure_is_kept_and_the_counts_tell_what_changed(route):
    refined = refined_by(route, LITTLE, seed=0)
    after = refined.tree
    np.testing.assert_array_equal(after.feature, WRONG.feature)
    np.testing.assert_array_equal(after.children_left, WRONG.children_left)
    np.testing.assert_array_equal(after.children_right, WRONG.children_right)
    assert refined.thresholds_moved == np.count_nonzero(after.threshold != WRONG.threshold)
    assert refined.leaves_changed == np.count_nonzero(after.action != WRONG.action)
    assert refined.largest_threshold_move == np.abs(after.threshold - WRONG.threshold).max()
    assert (refined.training.timesteps, refined.training.gradient_steps) == (600, 9)
    assert refined.env_steps > 600
    expected = IMPROVED if refined.return_after > refined.return_before else NOT_IMPROVED
    assert refined.outcome == expected


def test_the_same_seed_and_generation_give_the_same_tree(route):
    one, two = (refined_by(route, LITTLE, seed=3) for _ in range(2))
    assert one.tree == two.tree
    assert (one.return_before, one.return_after) == (two.return_before, two.return_after)
    other = refined_by(route, LITTLE, seed=3, generation=80)
    assert other.training != one.training


def test_enough_ppo_mends_wrong_leaves(route):
    config = PPOConfig(max_timesteps=20_000, update_timesteps=2000, epochs=20, lr_actor=0.03)
    refined = refined_by(route, config, seed=1)
    assert refined.outcome == IMPROVED
    assert refined.return_after > 5 * refined.return_before
    assert refined.leaves_changed > 0


def test_a_failed_training_keeps_the_tree(route, monkeypatch):
    def broken(ddt, source, settings, seed, after_update):  # noqa: ARG001
        ddt.threshold.data.fill_(float("nan"))
        return TrainingRecord(timesteps=200, failure="the loss is not finite in update 1")

    monkeypatch.setattr(ppo_refiner, "train", broken)
    refined = refined_by(route, LITTLE, seed=0)
    assert refined.outcome == FAILED
    assert not refined.is_improved
    assert refined.tree == WRONG
    assert refined.return_before == refined.return_after


def test_with_snapshots_the_best_hard_tree_comes_back_and_without_the_last(route):
    good = split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1))
    for seeds, expected in ((np.arange(10), good), (np.arange(0), leaf(0))):
        snapshots = Snapshots(route, WRONG, seeds)
        assert snapshots.chosen == WRONG
        for tree in (leaf(1), good, leaf(0)):
            snapshots.look_at(tree)
        assert snapshots.chosen == expected
        assert (snapshots.env_steps > 0) == (len(seeds) > 0)


def test_a_training_that_only_harms_brings_back_the_tree_as_it_was(route):
    good = split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1))
    harmful = replace(LITTLE, lr_actor=10.0)
    assert refined_by(route, harmful, good, seed=0).return_after < 300
    refined = refined_by(route, replace(harmful, snapshot_episodes=50), good, seed=0)
    assert refined.tree == good
    assert refined.outcome == NOT_IMPROVED


def test_snapshots_watch_and_do_not_disturb_the_training(route):
    plain, watched = (refined_by(route, replace(LITTLE, snapshot_episodes=n), seed=3) for n in (0, 5))
    assert plain.training == watched.training
    assert plain.return_before == watched.return_before
    assert watched.env_steps > plain.env_steps


def test_another_attempt_in_the_same_generation_draws_other_numbers(route):
    one, two = (refined_by(route, LITTLE, seed=3, attempt=attempt) for attempt in (0, 1))
    assert one.training != two.training


def test_surer_leaves_give_a_soft_tree_that_acts_more_like_the_hard_one(route):
    good = split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1))
    soft, sure = (
        refined_by(route, replace(LITTLE, leaf_scale=scale), good, seed=0).training.soft_return
        for scale in (1.0, 20.0)
    )
    assert soft < 200 < sure


def test_a_factor_multiplies_the_timesteps(route):
    (tuned,) = PPORefiner(route, LITTLE).tune([WRONG], [np.random.default_rng(0)], Effort(factor=2))
    assert tuned.training.timesteps == 2 * LITTLE.max_timesteps


OF_TRAINING = {
    "max_timesteps": 800,
    "update_timesteps": 100,
    "epochs": 5,
    "clip_epsilon": 0.1,
    "gamma": 0.5,
    "gae_lambda": 0.6,
    "lr_actor": 0.7,
    "lr_critic": 0.8,
    "entropy_coeff": 0.3,
    "critic_coeff": 0.4,
    "critic_hidden": (8,),
    "scale_features": True,
    "scale_critic": True,
    "alpha_final": 9.0,
    "lr_thresholds": 0.2,
    "optimizer": "adam",
    "minibatch_size": 50,
    "entropy_final": 0.05,
}
OF_THE_TREE = {"alpha": 7.0, "leaf_sd": 0.9, "leaf_scale": 3.0}


@pytest.fixture
def asked(route, monkeypatch):
    """Return what a refinement with a change asks of softening, of its source, and of training."""

    def asked(**change):
        said = {}

        def soften(tree, n_actions, **settings):
            said["soften"] = {name: settings[name] for name in OF_THE_TREE}
            return original["soften"](tree, n_actions, **settings)

        def open_source(spec, source, rng):
            said["source"] = source
            return original["open_source"](spec, source, rng=rng)

        def train(_ddt, _source, settings, **_):
            said["train"] = asdict(settings)
            return TrainingRecord()

        for of in (soften, open_source, train):
            monkeypatch.setattr(ppo_refiner, of.__name__, of)
        PPORefiner(route, replace(LITTLE, **change)).tune([WRONG], [np.random.default_rng(0)])
        return said

    original = {name: getattr(ppo_refiner, name) for name in ("soften", "open_source")}
    return asked


def test_every_setting_reaches_what_it_sets_and_nothing_else(asked):
    plain = asked()
    for name, value in OF_TRAINING.items():
        changed = {**plain["train"], {"critic_hidden": "hidden"}.get(name, name): value}
        assert asked(**{name: value}) == {**plain, "train": changed}
    for name, value in OF_THE_TREE.items():
        assert asked(**{name: value}) == {**plain, "soften": {**plain["soften"], name: value}}
    assert asked(source="fused") == {**plain, "source": "fused"}
    tested = {*OF_TRAINING, *OF_THE_TREE, "source", "snapshot_episodes"}
    assert tested == {field.name for field in fields(PPOConfig)}, "snapshots have tests of their own"
