"""What a generation refines and when, and what it takes for the best."""

from generations_for_tests import last_state, refining, run
from problems_for_tests import BAD, GOOD, Answers, leaf, problem_of
from states_for_tests import told_apart

from ge_torchrl.ge.encoding import snap
from ge_torchrl.run.recording import refinement_records
from ge_torchrl.search.archive import REFINEMENT
from ge_torchrl.search.refinement import FAILED, IMPROVED, NOT_IMPROVED


class TestSchedule:
    def test_refinements_follow_it_and_without_write_back_never_touch_the_population(self, opened):
        script = [Answers(GOOD), Answers(BAD), Answers(BAD, failure="broke")]
        problem = refining(opened, *script, refiner={"write_back": False})
        found = run(problem, 7)
        outcomes = {
            state.generation: event.refinement.outcome
            for state, events in found
            for event in events.refinements
        }
        assert outcomes == {2: IMPROVED, 4: NOT_IMPROVED, 6: FAILED}
        for (state, _), (without, _) in zip(found, run(problem_of(opened), 7), strict=True):
            assert told_apart(state.population) == told_apart(without.population)
        assert (state.counts.refinements, state.counts.improved, state.counts.refined) == (3, 1, 3)

    def test_a_list_of_generations_goes_before_it(self, opened):
        schedule = {"every": 2, "generations": [1, 5]}
        problem = refining(opened, Answers(), Answers(), refiner={"schedule": schedule})
        due = [state.generation for state, events in run(problem, 7) if events.refinements]
        assert due == [1, 5]

    def test_several_candidates_are_one_batch_of_different_individuals(self, opened):
        problem = refining(opened, Answers(), Answers(), refiner={"candidates": 3})
        for state, events in run(problem, 5)[2::2]:
            individuals = {event.refinement.proposal.individual for event in events.refinements}
            assert len(individuals) == 3, state.generation
        assert [len(trees) for trees in problem.refiner.asked] == [3, 3]

    def test_of_each_size_the_structures_that_were_not_refined_yet_come_first(self, opened):
        settings = {"candidates": 4, "write_back": False}
        problem = refining(opened, Answers(), Answers(), refiner=settings, ge={"population_size": 60})
        state = last_state(problem, 5)
        first, second = problem.refiner.asked
        assert len({tree.structure for tree in first}) == len(first) == 4
        assert len({tree.num_decision_nodes for tree in first}) > 1
        # Where a structure comes again, those that never came before went before it.
        again = [tree.structure in {tree.structure for tree in first} for tree in second]
        assert again == sorted(again)
        assert not again[0]
        assert sum(state.times_refined.values()) == 8
        assert state.times_refined[first[0].structure] >= 1

    def test_where_nobody_may_be_refined_that_is_told(self, opened):
        # Every fitness counts as the lowest possible.
        problem = refining(opened, env={"lowest_return": 500}, refiner={"choice": "best_or_random"})
        found = run(problem, 5)
        assert [events.redraws for _, events in found] == [None, None, 20, None, 20]
        assert (problem.refiner.asked, found[-1][0].counts.refinements) == ([], 0)
        (record,) = refinement_records(*found[2])
        assert (record.outcome, record.redraws, record.generation) == ("skipped", 20, 2)


class TestBestRefined:
    def test_only_an_improved_tree_can_become_the_best(self, opened):
        script = [Answers(BAD), Answers(GOOD), Answers(BAD)]
        problem = refining(opened, *script, refiner={"write_back": False})
        found = run(problem, 7)
        best = [state.best_refined for state, _ in found]
        assert best[:4] == [None] * 4
        assert {(one.tree, one.origin) for one in best[4:]} == {(GOOD, REFINEMENT)}
        assert best[-1].fitness > 100
        assert found[-1][0].best_fitness == best[-1].fitness
        assert [event.new_best for _, events in found for event in events.refinements] == [False, True, False]

    def test_what_the_grammar_can_say_is_preferred_with_its_own_fitness(self, opened):
        problem = refining(opened, Answers(GOOD))
        problem = problem_of(
            opened, problem.refiner, Answers(leaf(0)), refiner={"measuring_episodes": 5}, polish={"every": 2}
        )
        (*_, (state, events)) = run(problem, 3)
        (event,) = events.refinements
        assert state.best_refined.tree == snap(GOOD, problem.tables.grammar)
        assert state.best_refined.fitness == event.refinement.fitness_snapped
