"""Climbing: winners are kept and raced against next, who is stuck is challenged, a limit loses nothing."""

import numpy as np
import pytest
from mirrors_for_tests import MIRRORS
from problems_for_tests import GOOD, POOR, Analytic, member, problem_of
from states_for_tests import plain

from ge_torchrl.environments.backend import Limit
from ge_torchrl.ge.encoding import can_derive
from ge_torchrl.refiners.folding import half_of
from ge_torchrl.search import climbing
from ge_torchrl.search.archive import Archive, confirmed
from ge_torchrl.search.climbing import Climber, Climbers, climb
from ge_torchrl.search.neighbours import near, random_trees
from ge_torchrl.search.problem import Problem

ARCHIVE = {"keep": 2, "max_nodes": 5, "races": 3, "raced": 6}
SEEN = np.random.default_rng(0).normal(size=(50, 4)).astype(np.float32)


def best_near_3(tree):
    """A return that is the higher, the nearer the sum of thresholds comes to 3."""
    return -abs(3.0 - float(np.abs(tree.threshold).sum()))


def problem(value=best_near_3, **archive):
    return problem_of(Analytic(value), archive={**ARCHIVE, **archive})


def mirrored(of):
    return Problem(of.config, of.tables, of.backend, None, None, MIRRORS["cart"])


def climbed(of, n_generations):
    archive, climbers = Archive(), Climbers()
    for generation in range(1, n_generations + 1):
        archive, climbers = climb(of, archive, climbers, generation)
    return archive, climbers


class TestClimb:
    def test_it_gets_better_and_the_archive_knows(self):
        first, _ = climbed(problem(), 1)
        later, _ = climbed(problem(), 6)
        best = [max(one.archive_fitness for one in archive.members) for archive in (first, later)]
        assert best[1] > best[0]
        assert {one.origin for one in later.members} == {"race"}

    def test_the_same_generation_gives_the_same(self):
        assert plain(climbed(problem(), 3)) == plain(climbed(problem(), 3))

    def test_who_is_stuck_waits_for_a_challenger_and_the_better_one_goes_on(self, monkeypatch):
        monkeypatch.setattr(climbing, "_STUCK", 1)
        of = problem(lambda tree: float(tree == GOOD))
        stuck = Climbers(Climber(GOOD, SEEN, unbeaten=1), patience=1)
        _, climbers = climb(of, Archive(), stuck, 1)
        assert climbers.waiting is not None
        assert climbers.waiting.tree == GOOD
        # One challenger after the other loses, and then who waited goes on, with more patience.
        for generation in range(2, 5):
            _, climbers = climb(of, Archive(), climbers, generation)
        assert climbers.patience > 1
        assert GOOD in {one.tree for one in (climbers.climber, climbers.waiting) if one is not None}

    def test_a_kept_tree_that_is_better_than_both_waits_for_the_next_challenger(self, monkeypatch):
        monkeypatch.setattr(climbing, "_STUCK", 1)
        of = problem(lambda tree: float(tree == GOOD), races=1)
        climbers = Climbers(Climber(POOR, SEEN, unbeaten=1), waiting=Climber(POOR, SEEN))
        _, climbers = climb(of, Archive((member(GOOD, 1.0),)), climbers, 1)
        assert climbers.waiting is not None
        assert climbers.waiting.tree == GOOD

    def test_a_limit_ends_it_and_what_was_won_is_kept(self):
        of = problem()
        of.backend.limit = Limit(deadline=np.inf, max_env_steps=60_000)
        archive, climbers = climbed(of, 60)
        assert archive.members
        assert climbers != Climbers()

    def test_without_races_nothing_happens(self):
        of = problem(races=0)
        assert plain(climb(of, Archive(), Climbers(), 1)) == plain((Archive(), Climbers()))
        assert not of.backend.batches

    def test_a_grammar_of_leaves_alone_has_nothing_to_climb(self):
        of = problem_of(Analytic(best_near_3), grammar={"bnf": "<dt> ::= left | right"}, archive=ARCHIVE)
        assert climbed(of, 1)[1].climber is None


class TestNear:
    def test_neighbours_are_other_trees_of_the_grammar_each_once(self):
        of = problem()
        trees = near(of, GOOD, SEEN, 40, np.random.default_rng(0))
        assert len(set(trees)) == len(trees) > 10
        assert GOOD not in trees
        assert all(can_derive(tree, of.tables) and 0 < tree.num_decision_nodes <= 5 for tree in trees)

    def test_in_a_mirror_they_and_random_trees_are_their_own_images(self):
        of = mirrored(problem())
        found = random_trees(of, 60, np.random.default_rng(0)).trees()
        assert len(found) > 20
        for tree in found[:10]:
            neighbours = near(of, tree, SEEN, 10, np.random.default_rng(1))
            assert all(half_of(one, MIRRORS["cart"]) is not None for one in neighbours)

    def test_thresholds_of_random_trees_come_from_what_was_seen(self):
        seen = np.full((3, 4), 0.25, np.float32)
        found = random_trees(problem(), 20, np.random.default_rng(0), seen)
        assert set(found.arrays.threshold.tolist()) == {0.25}


class TestConfirmed:
    @pytest.mark.parametrize("n", [20, 60])
    def test_more_episodes_weigh_as_many_as_they_are(self, n):
        of = problem()
        archive = Archive((member(POOR, 10.0),))
        after = confirmed(of, archive, POOR, np.zeros(n))
        assert after.members[0].archive_fitness == pytest.approx(10.0 * 20 / (20 + n))
        assert after.members[0].confirmed_on == n

    def test_who_was_lucky_falls_behind(self):
        other = GOOD.with_parameters(GOOD.parameters + np.float32(0.125))
        archive = Archive((member(GOOD, 10.0), member(other, 8.0)))
        after = confirmed(problem(), archive, GOOD, np.zeros(100))
        assert [one.tree for one in after.members] == [other, GOOD]

    def test_who_is_not_kept_changes_nothing(self):
        archive = Archive((member(POOR, 10.0),))
        assert confirmed(problem(), archive, GOOD, np.zeros(5)) is archive
