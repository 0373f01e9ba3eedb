"""The strategy finds a tree's numbers on few episodes, takes more where they tell nothing, and keeps to its seed."""

from __future__ import annotations

import time

import numpy as np
import pytest
from fake_backend import FakeBackend

from ge_torchrl.environments.backend import Limit, LimitReachedError
from ge_torchrl.refiners.strategy import FEWEST_EPISODES, Strategy, told_apart
from ge_torchrl.refiners.ties import Ties
from ge_torchrl.trees.tree import DecisionTree

leaf, weighted = DecisionTree.leaf, DecisionTree.weighted_split
BEST = weighted([0, 1], [1.0, -2.0], 0.5, leaf(0), leaf(1))
UNITS = np.array([1.0, 1.0, 0.05])
FAR = BEST.with_parameters([3.0, -4.0, -1.8])


def value(tree):
    """0 for the best tree; a unit of each number costs as much."""
    return -float(np.square((tree.parameters.astype(np.float64) - BEST.parameters) / UNITS).sum())


def strategy(backend=None, ties=None, seed=0, tree=FAR, **changes):
    ties = Ties.none(len(tree.parameters)) if ties is None else ties
    rng = np.random.default_rng(seed)
    return Strategy(backend or FakeBackend(value, luck=5.0), tree, ties, UNITS, 0.5, "starts", rng, **changes)


def test_numbers_find_their_best_values_although_episodes_differ_by_luck():
    search = strategy()
    before = value(search.tree)
    search.advance(30_000)
    assert value(search.tree) > max(0.01 * before, -0.1)
    assert search.tree.structure == FAR.structure


def test_a_start_at_zero_has_its_first_points_about_zero():
    trees = []
    backend = FakeBackend(lambda tree: trees.append(tree) or value(tree))
    strategy(backend, from_zero=True).advance(1)
    numbers = np.array([tree.parameters for tree in trees])
    assert numbers.shape[0] == 12
    assert (np.abs(numbers / UNITS) < 3).all()


def test_tied_numbers_stay_tied():
    ties = Ties(np.array([0, 1, 1]), np.array([1.0, 1.0, -1.0]))
    search = strategy(ties=ties, tree=BEST.with_parameters([0.0, 1.0, -1.0]))
    search.advance(2000)
    assert search.tree.parameters[1] == -search.tree.parameters[2] != 1.0


def test_every_round_has_new_episodes_and_all_points_have_the_same():
    backend = FakeBackend(value)
    strategy(backend).advance(2000)
    assert all(points == 12 for points, _ in backend.batches)
    assert len(set(backend.episodes)) == len(backend.episodes)


def test_where_trees_are_told_apart_few_episodes_do_and_where_they_are_not_they_grow():
    clear, blurred = strategy(FakeBackend(value)), strategy(Noise())
    for search in (clear, blurred):
        search.advance(20 * 12 * 10 * FEWEST_EPISODES)
    assert clear.episodes == FEWEST_EPISODES
    assert blurred.episodes >= 4 * FEWEST_EPISODES


class Noise(FakeBackend):
    """All trees are equal; each has its own luck."""

    def __init__(self):
        super().__init__(lambda _: 0.0)
        self.rng = np.random.default_rng(0)

    def evaluate(self, forest, seeds, purpose, *, visits=False):
        outcomes = super().evaluate(forest, seeds, purpose, visits=visits)
        outcomes.returns[:] = self.rng.normal(size=outcomes.returns.shape)
        return outcomes


def test_the_same_seed_gives_the_same_tree_however_often_it_is_interrupted():
    one, other = strategy(), strategy()
    one.advance(3600)
    for _ in range(10):
        other.advance(360)
    assert one.rounds == other.rounds
    assert one.tree == other.tree
    third = strategy(seed=1)
    third.advance(3600)
    assert third.tree != one.tree


def test_without_a_round_it_stands_for_the_tree_it_was_given():
    assert strategy().tree == FAR


def test_without_anything_to_move_it_has_ended():
    search = strategy(ties=Ties(np.zeros(3, np.int64), np.zeros(3)))
    assert search.has_ended
    search.advance(1000)
    assert search.tree == FAR


def test_a_limit_ends_it():
    backend = FakeBackend(value)
    backend.limit = Limit(max_env_steps=1000)
    with pytest.raises(LimitReachedError):
        strategy(backend).advance(10_000)


def test_equal_trees_are_told_apart_by_chance_alone_and_unequal_ones_clearly():
    rng = np.random.default_rng(0)
    equal = [told_apart(rng.normal(size=(12, 6))) for _ in range(400)]
    assert 0.9 < np.mean(equal) < 1.35
    luck = 100 * rng.normal(size=(1, 6))
    assert told_apart(np.arange(12)[:, np.newaxis] + luck + 0.1 * rng.normal(size=(12, 6))) > 100
    assert told_apart(np.zeros((12, 6))) == 0
    assert told_apart(np.arange(12.0)[:, np.newaxis] + np.zeros((1, 6))) == np.inf


def test_of_many_numbers_each_moves_by_itself_which_takes_no_longer_than_the_episodes():
    n = 1000
    tree = weighted(range(n), np.ones(n), 0.0, leaf(0), leaf(1))
    goal = np.random.default_rng(0).normal(size=len(tree.parameters))

    def near(tree):
        return -float(np.square(tree.parameters - goal).mean())

    backend, rng = FakeBackend(near, luck=0.01), np.random.default_rng(0)
    search = Strategy(backend, tree, Ties.none(len(goal)), np.ones(len(goal)), 0.3, "starts", rng)
    before, started = near(tree), time.process_time()
    search.advance(60_000)
    assert near(search.tree) > before + 0.05
    # A covariance of all numbers would take a minute.
    assert time.process_time() - started < 20
