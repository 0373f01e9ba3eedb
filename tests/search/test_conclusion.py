"""The end of a search: chosen by validation, tested."""

from dataclasses import replace

import numpy as np
import pytest
from problems_for_tests import (
    BAD,
    GOOD,
    GOOD_WITH_DEAD_BRANCH,
    POOR,
    POORER,
    Analytic,
    contender,
    leaf,
    problem_of,
)

from ge_torchrl.environments.backend import Limit, LimitReachedError
from ge_torchrl.search.archive import POPULATION, REFINEMENT, Archive, offer
from ge_torchrl.search.conclusion import (
    TEST,
    VALIDATION,
    choose,
    contenders_of,
    examine,
)
from ge_torchrl.search.fitness import test_seeds as unseen_seeds
from ge_torchrl.search.fitness import validation_seeds
from ge_torchrl.search.fitting_limits import evaluate_what_fits
from ge_torchrl.search.step import first_state
from ge_torchrl.trees.forest import Forest


def chosen(backend, *trees, **evaluation):
    settings = {"validation_episodes": 50, **evaluation}
    problem = problem_of(backend, evaluation=settings)
    return choose(problem, [tree if not hasattr(tree, "structure") else contender(tree) for tree in trees])


class TestChoose:
    def test_a_lucky_leader_is_unmasked_by_validation(self, backend):
        champion, _ = chosen(backend, contender(POOR, 500.0), contender(GOOD, 400.0))
        assert (champion.full, champion.train_fitness, champion.origin) == (GOOD, 400.0, POPULATION)
        assert champion.validation_returns.mean() > 490

    def test_all_are_measured_in_one_batch_on_validations_episodes(self, backend):
        problem = problem_of(backend)
        choose(problem, [contender(POOR), contender(GOOD)])
        assert backend.batches == [(2, VALIDATION)]
        assert backend.seeds == [validation_seeds(problem.config).tolist()]

    def test_the_champion_is_pruned_by_its_visits_and_acts_alike_on_every_episode(self, backend):
        """Law 7, on the episodes that counted the visits."""
        champion, _ = chosen(backend, GOOD_WITH_DEAD_BRANCH)
        assert (champion.full, champion.pruned) == (GOOD_WITH_DEAD_BRANCH, GOOD)
        both = Forest.stack([champion.full, champion.pruned])
        outcomes = backend.evaluate(both, np.array(backend.seeds[0]), "test")
        np.testing.assert_array_equal(outcomes.returns[0], outcomes.returns[1])

    def test_of_equally_good_trees_the_smaller_is_taken_and_of_these_the_first(self, backend):
        assert chosen(Analytic(lambda _: 1.0), GOOD, POOR, POORER)[0].full == POOR
        first, second = contender(GOOD, origin=REFINEMENT), contender(GOOD, origin=POPULATION)
        assert chosen(backend, first, second)[0].origin == REFINEMENT

    def test_the_best_of_each_pruned_size_is_chosen_too(self, backend):
        champion, by_size = chosen(
            backend, POORER, contender(GOOD_WITH_DEAD_BRANCH, 7.0, REFINEMENT), POOR, leaf(0)
        )
        assert [one.pruned for one in by_size] == [leaf(0), POOR, GOOD]
        assert by_size[2] is champion
        assert [(one.origin, one.train_fitness) for one in by_size[1:]] == [
            (POPULATION, 1.0),
            (REFINEMENT, 7.0),
        ]

    def test_steadiness_counts_where_it_is_asked_for(self):
        class Wild(Analytic):
            def evaluate(self, forest, seeds, purpose, *, visits=False):
                outcomes = super().evaluate(forest, seeds, purpose, visits=visits)
                wild = [tree == GOOD for tree in forest.trees()]
                outcomes.returns[wild, ::2] += 30
                return outcomes

        assert chosen(Wild(lambda _: 1.0), POOR, GOOD)[0].full == GOOD
        assert chosen(Wild(lambda _: 1.0), POOR, GOOD, std_penalty=2.0)[0].full == POOR


class TestContenders:
    @staticmethod
    def state(problem, best_refined=None, kept=()):
        state, _ = first_state(problem)
        archive = offer(problem, Archive(), [contender(tree) for tree in kept])
        return replace(state, archive=archive, best_refined=best_refined)

    def test_without_an_archive_it_is_the_fitter_of_individual_and_refined_tree_as_in_the_thesis(
        self, opened
    ):
        problem = problem_of(opened)
        state = self.state(problem)
        (individual,) = contenders_of(problem, state)
        assert (individual.fitness, individual.origin) == (state.population.fitness.max(), POPULATION)
        for fitness, winner in ((1e6, REFINEMENT), (-1e6, POPULATION)):
            refined = contender(GOOD, fitness, REFINEMENT)
            (one,) = contenders_of(problem, replace(state, best_refined=refined))
            assert one.origin == winner

    def test_kept_trees_compete_and_know_where_they_come_from(self, opened):
        problem = problem_of(opened, archive={"keep": 3})
        refined = contender(BAD, 3.0, REFINEMENT)
        state = self.state(problem, refined, kept=[GOOD, POOR])
        contenders = contenders_of(problem, state)
        assert [one.tree for one in contenders[:2]] == [POOR, GOOD]
        assert contenders[-1] is refined
        assert len(contenders) == 4

    def test_without_any_tree_there_is_nobody(self, opened):
        problem = problem_of(opened, ge={"genotype_length": 2}, archive={"keep": 3})
        assert contenders_of(problem, self.state(problem)) == []

    def test_the_individual_is_told_as_its_genotype_maps_to_it(self, opened):
        for seed in range(5):
            problem = problem_of(opened, seed=seed)
            state = self.state(problem)
            (one,) = contenders_of(problem, state)
            simple = state.population.forest.tree(state.population.best)
            assert one.tree.num_decision_nodes >= simple.num_decision_nodes


class TestExamine:
    def test_the_champion_both_ways_and_the_best_of_each_size_are_tested_once(self, backend):
        problem = problem_of(backend, archive={"keep": 3})
        champion, by_size = choose(problem, [contender(GOOD_WITH_DEAD_BRANCH), contender(POOR)])
        backend.batches.clear()
        verdict = examine(problem, champion, by_size)
        assert backend.batches == [(3, TEST)]
        assert backend.seeds[-1] == unseen_seeds(problem.config).tolist()
        returns = backend.evaluate(Forest.stack([GOOD, POOR]), unseen_seeds(problem.config), "test").returns
        np.testing.assert_array_equal(verdict.test_returns, returns[0])
        np.testing.assert_array_equal(verdict.test_returns_full, returns[0])
        np.testing.assert_array_equal(verdict.test_returns_by_size, returns[::-1])
        assert verdict.by_size == by_size

    def test_without_an_archive_there_is_no_table_by_size(self, backend):
        problem = problem_of(backend)
        verdict = examine(problem, *choose(problem, [contender(GOOD)]))
        assert (verdict.by_size, verdict.test_returns_by_size.shape) == ((), (0, 20))


class TestWhatFits:
    TREES = (GOOD, POOR, POORER, leaf(0), BAD)

    def evaluate(self, backend, n_episodes=64, at_least=1):
        problem, seeds = problem_of(backend), np.arange(n_episodes)
        return evaluate_what_fits(problem, self.TREES, seeds, "test", visits=True, at_least=at_least)

    def test_parts_are_what_one_call_would_give(self, backend):
        whole = self.evaluate(backend)
        backend.limit = Limit(max_env_steps=10**12)
        for at_least in (1, 2, 5):
            parts = self.evaluate(backend, at_least=at_least)
            np.testing.assert_array_equal(parts.returns, whole.returns)
            np.testing.assert_array_equal(parts.lengths, whole.lengths)
            np.testing.assert_array_equal(parts.leaf_visits, whole.leaf_visits)

    def test_a_limit_leaves_the_first_episodes_of_all_trees(self, backend):
        whole = self.evaluate(backend)
        backend.limit = limit = Limit(max_env_steps=backend.steps.total() + whole.env_steps // 2)
        part = self.evaluate(backend)
        n_episodes = part.returns.shape[1]
        assert 1 <= n_episodes < 64
        np.testing.assert_array_equal(part.returns, whole.returns[:, :n_episodes])
        assert part.leaf_visits.sum() == part.env_steps
        assert backend.limit is limit

    @pytest.mark.parametrize("at_least", [1, 2])
    def test_where_nothing_is_left_the_first_trees_run_an_episode(self, backend, at_least):
        whole = self.evaluate(backend)
        backend.limit = limit = Limit(max_env_steps=1)
        part = self.evaluate(backend, at_least=at_least)
        np.testing.assert_array_equal(part.returns, whole.returns[:at_least, :1])
        assert part.leaf_visits.sum() == part.env_steps
        assert self.evaluate(backend, n_episodes=1).returns.shape == (1, 1)
        assert backend.limit is limit

    def test_the_utmost_holds_for_the_least_too(self, backend):
        backend.limit = limit = Limit(max_env_steps=1, utmost=Limit(max_env_steps=2))
        with pytest.raises(LimitReachedError):
            self.evaluate(backend)
        assert backend.limit is limit

    def test_the_most_promising_contenders_are_validated_first(self, backend):
        backend.limit = Limit(max_env_steps=1)
        champion, by_size = chosen(backend, contender(POOR, 40.0), contender(GOOD, 400.0), leaf(0))
        assert champion.full == GOOD
        assert by_size == (champion,)
        assert champion.validation_returns.shape == (1,)

    def test_the_champion_is_tested_both_ways_and_others_where_they_can_be(self, backend):
        problem = problem_of(backend, archive={"keep": 3})
        champion, by_size = choose(problem, [contender(GOOD_WITH_DEAD_BRANCH), contender(POOR)])
        backend.limit = Limit(max_env_steps=1)
        verdict = examine(problem, champion, by_size)
        assert verdict.test_returns.shape == verdict.test_returns_full.shape == (1,)
        assert np.isnan(verdict.test_returns_by_size).all(axis=1).tolist() == [True, False]
