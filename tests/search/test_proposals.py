"""Which trees a generation refines: individuals, and kept trees again."""

import numpy as np
import pytest
from forests_for_tests import simplify_one
from problems_for_tests import (
    GOOD,
    POOR,
    Analytic,
    comb,
    leaf,
    member,
    problem_of,
    split,
)

from ge_torchrl.refiners.protocol import FIRST, Effort
from ge_torchrl.search.archive import Archive
from ge_torchrl.search.population import Population, first_population
from ge_torchrl.search.proposals import (
    INDIVIDUAL,
    KEPT,
    Eligibility,
    best_or_random,
    fittest_of_each_structure,
    in_turns,
    of_each_size,
    propose_individuals,
    propose_kept,
)
from ge_torchrl.trees.forest import Forest

CARTPOLE = Eligibility(solved_at=475.0, lowest_return=None)
MOUNTAIN_CAR = Eligibility(solved_at=-110.0, lowest_return=-200.0)


@pytest.mark.parametrize(
    ("eligibility", "n_nodes", "fitness", "admitted"),
    [
        (CARTPOLE, 2, 474.9, True),
        (CARTPOLE, 2, 475.0, False),  # (a) solves the task
        (CARTPOLE, 0, 9.0, False),  # (b) one leaf
        (CARTPOLE, 1, 200.0, False),  # (c) one condition and two leaves
        (CARTPOLE, 2, 9.0, True),
        (MOUNTAIN_CAR, 2, -200.0, False),  # (d) never saw a reward
        (MOUNTAIN_CAR, 2, -199.9, True),
        (MOUNTAIN_CAR, 2, -110.0, False),
        (MOUNTAIN_CAR, 0, -np.inf, False),  # no tree at all
        (Eligibility(None, None), 2, 1e9, True),
        (Eligibility(None, None, min_nodes=3), 2, 9.0, False),
        (Eligibility(None, None, min_nodes=3), 3, 9.0, True),
        (Eligibility(None, None, min_nodes=1), 1, 9.0, True),
        (Eligibility(None, None, min_nodes=1), 0, 9.0, False),
    ],
)
def test_rules_of_rejection(eligibility, n_nodes, fitness, admitted):
    """Each rule of thesis section 3.3 by itself."""
    assert eligibility.admits(n_nodes, fitness) == admitted


class ScriptedRandom:
    """Draws what the test wrote down."""

    def __init__(self, first, draws):
        self.first, self.draws = first, list(draws)

    def random(self):
        return self.first

    def integers(self, n):
        assert n > 0
        return self.draws.pop(0)

    def choice(self, others, size, replace):
        assert not replace
        return others[:size]


class TestBestOrRandom:
    @staticmethod
    def choose(fitness, admitted, *, first, draws=()):
        rng = ScriptedRandom(first, draws)
        chosen = best_or_random(np.array(fitness, float), np.array(admitted), 1, rng)
        assert rng.draws == [], "everything that was written down was drawn"
        return chosen

    def test_the_first_draw_is_the_best_or_a_random_tree(self):
        assert self.choose([10, 300, 20], [True] * 3, first=0.49) == ([1], "best", 0)
        assert self.choose([10, 300, 20], [True] * 3, first=0.5, draws=[2]) == ([2], "random", 0)

    def test_a_rejected_tree_is_redrawn_at_random_and_counted(self):
        chosen = self.choose([500, 9, 30], [False, False, True], first=0.0, draws=[1, 2])
        assert chosen == ([2], "best", 2)

    def test_after_population_size_redraws_there_is_no_candidate(self):
        chosen = self.choose([500, 480, 475], [False] * 3, first=0.9, draws=[0, 1, 2, 0])
        assert chosen == ([], "random", 3)

    def test_the_last_redraw_still_counts(self):
        chosen = self.choose([500, 9, 30], [False, False, True], first=0.0, draws=[0, 1, 2])
        assert chosen == ([2], "best", 3)

    def test_half_of_the_first_draws_are_the_best(self):
        rng = np.random.default_rng(0)
        fitness, admitted = np.arange(10.0), np.ones(10, bool)
        chosen = [best_or_random(fitness, admitted, 1, rng)[1] for _ in range(2000)]
        assert abs(chosen.count("best") - 1000) <= 4 * np.sqrt(500)

    @pytest.mark.parametrize(("n_candidates", "n_chosen"), [(1, 1), (2, 2), (24, 24), (30, 24)])
    def test_further_candidates_are_random_different_and_admitted(self, n_candidates, n_chosen):
        fitness = np.tile([10.0, 9.0, 30.0, 20.0, 500.0], 8)
        admitted = np.tile([True, False, True, True, False], 8)
        for seed in range(20):
            rng, same = np.random.default_rng(seed), np.random.default_rng(seed)
            individuals, *told = best_or_random(fitness, admitted, n_candidates, rng)
            alone, *told_alone = best_or_random(fitness, admitted, 1, same)
            assert (individuals[:1], told) == (alone, told_alone)
            assert len(set(individuals)) == len(individuals) == n_chosen
            assert admitted[individuals].all()


class TestOfEachSize:
    # Sizes 2, 2, 2, 3, 3, 4, and one that is too small; the first two are of one structure.
    TREES = (
        comb(0, 1),
        comb(0, 1, threshold=0.7),
        comb(1, 0),
        comb(0, 1, 2),
        comb(2, 1, 0),
        comb(0, 0, 0, 0),
        comb(3),
    )
    FITNESS = (50, 60, 55, 20, 30, 10, 70)

    def chosen(self, times_refined, eligibility=CARTPOLE):
        admitted = [
            eligibility.admits(tree.num_decision_nodes, fitness)
            for tree, fitness in zip(self.TREES, self.FITNESS, strict=True)
        ]
        forest = Forest.stack(self.TREES)
        return of_each_size(np.array(self.FITNESS, float), forest, np.array(admitted), times_refined)

    def test_the_fittest_of_every_size_goes_first_and_alike_trees_go_once(self):
        assert self.chosen({}) == [1, 4, 5, 2, 3]

    def test_structures_seldom_refined_go_before_the_fittest(self):
        refined = {self.TREES[0].structure: 2, self.TREES[4].structure: 1}
        assert self.chosen(refined) == [5, 2, 3, 4, 1]

    def test_who_may_not_be_refined_is_left_out(self):
        # Without the second tree the first speaks for their structure.
        assert self.chosen({}, Eligibility(solved_at=60.0, lowest_return=20.0)) == [2, 4, 0]

    def test_where_nobody_is_admitted_nobody_is_chosen(self):
        assert self.chosen({}, Eligibility(None, None, min_nodes=9)) == []


def test_of_one_structure_the_fittest_and_of_these_the_first_speaks():
    forest = Forest.stack([comb(0), comb(0, threshold=0.2), comb(1), comb(0, threshold=0.3)])
    alike = fittest_of_each_structure(forest, np.array([1.0, 2.0, 0.0, 2.0]), np.arange(4))
    assert alike == {comb(0).structure: 1, comb(1).structure: 2}


def test_the_fittest_of_every_size_come_first_then_the_second():
    fitness = np.array([5.0, 9.0, 1.0, 7.0, 3.0])
    sizes = np.array([1, 2, 1, 2, 3])
    assert in_turns(fitness, sizes).tolist() == [1, 0, 4, 3, 2]


class TestIndividuals:
    # The second is the first, with a split that no bound lets anybody reach; and one of three decision nodes.
    TREES = (comb(2, 3), split(0, 99.0, comb(2, 3), leaf(0)), comb(3, 2, 3), leaf(0))

    @staticmethod
    def population(trees, fitness):
        forest = Forest.stack(trees)
        return Population(np.zeros((len(trees), 40), np.int32), forest, np.array(fitness, float))

    def propose(self, fitness, generation=2, times_refined=None, trees=TREES, **refiner):
        problem = problem_of(Analytic(lambda _: 0.0, solved_at=100.0), refiner=refiner)
        return propose_individuals(problem, self.population(trees, fitness), times_refined or {}, generation)

    def test_each_knows_whom_it_comes_from(self):
        drawn = self.propose([1, 2, 3, 4], candidates=5)
        told = [(one.tree, one.origin, one.individual, one.fitness, one.chosen) for one in drawn.proposals]
        assert told == [
            (self.TREES[2], INDIVIDUAL, 2, 3.0, "fittest"),
            (self.TREES[0], INDIVIDUAL, 0, 1.0, "fittest"),
            (self.TREES[1], INDIVIDUAL, 1, 2.0, "fittest"),
        ]
        assert {one.effort for one in drawn.proposals} == {FIRST}

    def test_so_many_candidates_and_those_first_whose_structure_was_seldom_refined(self):
        refined = {self.TREES[2].structure: 1}
        drawn = self.propose([1, 2, 3, 4], candidates=2, times_refined=refined)
        assert [one.individual for one in drawn.proposals] == [0, 1]

    def test_who_solves_the_task_or_is_too_small_is_left_out(self):
        assert [one.individual for one in self.propose([1, 100, 3, 4], candidates=5).proposals] == [2, 0]
        assert [one.individual for one in self.propose([1] * 4, candidates=5, min_nodes=3).proposals] == [
            1,
            2,
        ]

    def test_the_draw_of_the_thesis_counts_its_redraws_and_depends_on_the_generation_alone(self):
        drawn = []
        for generation in [*range(12), 7]:
            one = self.propose([1, 2, 3, 4], generation, choice="best_or_random")
            (proposal,) = one.proposals
            assert proposal.redraws == one.redraws
            if proposal.chosen == "best":
                assert one.redraws >= 1, "the best is a lone leaf, which is always rejected"
            drawn.append((proposal.individual, one.redraws))
        assert len({individual for individual, _ in drawn}) > 1
        assert drawn[-1] == drawn[7]

    def test_where_nobody_is_found_it_says_how_many_were_rejected(self):
        drawn = self.propose([100] * 4, choice="best_or_random")
        assert (drawn.proposals, drawn.redraws) == ((), 4)
        assert self.propose([100] * 4).proposals == ()

    def test_the_best_tree_is_chosen_or_a_random_one(self):
        drawn = [self.propose([1, 2, 3, 0], g, choice="best_or_random") for g in range(20)]
        at_once = [one.proposals[0] for one in drawn if one.redraws == 0]
        assert {one.individual for one in at_once if one.chosen == "best"} == {2}
        assert len({one.individual for one in at_once if one.chosen == "random"}) > 1

    def test_they_are_simplified_or_whole_where_they_are_kept_apart(self, opened):
        whole = simple = 0
        for seed in range(3):
            population = first_population(problem_of(opened, seed=seed)).population
            for simplify in (True, False):
                problem = problem_of(opened, seed=seed, refiner={"write_back": simplify, "candidates": 20})
                trees = [one.tree for one in propose_individuals(problem, population, {}, 2).proposals]
                not_simple = sum(simplify_one(tree, *opened.bounds) != tree for tree in trees)
                whole, simple = (whole, simple + not_simple) if simplify else (whole + not_simple, simple)
        assert simple == 0 < whole


def archive_of(*members):
    return Archive(tuple(sorted(members, key=lambda one: one.tree.num_decision_nodes)))


class TestKept:
    ARCHIVE = archive_of(member(leaf(0), 9.0), member(POOR, 40.0), member(GOOD, 400.0))

    @staticmethod
    def problem(revisit_factor):
        settings = {"keep": 3, "revisit_factor": revisit_factor}
        return problem_of(Analytic(lambda _: 0.0), archive=settings)

    def test_a_kept_tree_is_refined_again_with_a_larger_budget(self):
        (one,) = propose_kept(self.problem(4), self.ARCHIVE, 2)
        assert (one.origin, one.individual, one.effort) == (KEPT, None, Effort(4))
        assert one.fitness == {GOOD: 400.0, POOR: 40.0}[one.tree]
        assert propose_kept(self.problem(0), self.ARCHIVE, 2) == []

    def test_it_is_drawn_anew_in_every_generation(self):
        problem = self.problem(1)
        drawn = [propose_kept(problem, self.ARCHIVE, g)[0].tree for g in [*range(20), 3]]
        assert set(drawn) == {GOOD, POOR}, "a lone leaf has nothing to refine"
        assert drawn[-1] == drawn[3]
