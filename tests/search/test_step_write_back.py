"""What was refined takes its source's place in the population, in its codons, where it is fitter."""

import numpy as np
import pytest
from generations_for_tests import everything, last_state, refining, run
from problems_for_tests import BAD, GOOD, Analytic, Answers, leaf, split
from states_for_tests import told_apart

from ge_torchrl.ge.encoding import snap
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.search.fitness import archive_seeds, measure, training_seeds
from ge_torchrl.search.population import map_simplified, next_population
from ge_torchrl.search.refinement import IMPROVED
from ge_torchrl.trees.forest import Forest


class TestWriteBack:
    def test_a_fitter_tree_takes_its_sources_place_in_its_codons(self, opened):
        """Law 2, in the population."""
        problem = refining(opened, Answers(GOOD))
        *_, (before, _), (after, events) = run(problem, 3)
        evolved = next_population(problem, before.population, 2).population
        (event,) = events.refinements
        slot = event.refinement.proposal.individual
        assert event.written_back
        snapped = snap(GOOD, problem.tables.grammar)
        assert after.population.forest.tree(slot) == snapped != GOOD
        codons = after.population.codons[[slot]]
        assert map_population(codons, problem.tables).tree(0) == snapped
        seeds = training_seeds(problem.config, 2)
        (fitness,) = measure(opened, Forest.stack([snapped]), seeds, "test")
        assert after.population.fitness[slot] == fitness > evolved.fitness[slot]
        others = np.arange(20) != slot
        np.testing.assert_array_equal(after.population.codons[others], evolved.codons[others])
        np.testing.assert_array_equal(after.population.fitness[others], evolved.fitness[others])

    def test_the_population_is_at_all_times_what_its_genotypes_say(self, opened):
        problem = everything(opened)
        for state, _ in run(problem, 7):
            population = state.population
            assert told_apart(map_simplified(problem, population.codons)) == told_apart(population.forest)
            seeds = training_seeds(problem.config, state.generation)
            fitness = measure(opened, population.forest, seeds, "test")
            np.testing.assert_array_equal(fitness, population.fitness)

    def test_the_next_generation_descends_from_what_was_written(self, opened):
        fixed = {"evaluation": {"episodes": 3, "episode_seeds": "fixed"}}
        problem = refining(opened, Answers(GOOD), **fixed)
        (*_, (written, events), (after, _)) = run(problem, 4)
        slot = events.refinements[0].refinement.proposal.individual
        assert after.population.fitness[slot] >= written.population.fitness[slot] > 100

    @pytest.mark.parametrize(
        "answer",
        [
            BAD,  # not the fitter one
            lambda tree: tree,  # not another one
            split(0, 0.0, GOOD, GOOD),  # fitter, but the grammar does not test the position
            leaf(0),  # the grammar derives no lone leaf
        ],
    )
    def test_else_everything_stays_as_it_is(self, opened, answer):
        problem = refining(opened, Answers(answer))
        *_, (before, _), (after, events) = run(problem, 3)
        evolved = next_population(problem, before.population, 2).population
        assert told_apart(after.population) == told_apart(evolved)
        assert [event.written_back for event in events.refinements] == [False]

    def test_better_on_unseen_episodes_but_not_on_the_generations_own_is_not_enough(self):
        """The snapped tree and its source are compared on the episodes that the population is measured on."""
        source_wins = set()

        class Fickle(Analytic):
            def evaluate(self, forest, seeds, purpose, *, visits=False):
                outcomes = super().evaluate(forest, seeds, purpose, visits=visits)
                if tuple(seeds.tolist()) in source_wins:
                    outcomes.returns[:] = -outcomes.returns
                return outcomes

        def halved(tree):
            return tree.with_parameters(tree.parameters * np.float32(0.5))

        backend = Fickle(lambda tree: -float(np.abs(tree.threshold).sum()))
        problem = refining(backend, Answers(halved), Answers(halved))
        source_wins.add(tuple(training_seeds(problem.config, 2).tolist()))
        events = [event for _, of_generation in run(problem, 5) for event in of_generation.refinements]
        assert [event.refinement.outcome for event in events] == [IMPROVED, IMPROVED]
        assert [event.written_back for event in events] == [False, True]


class TestOneScale:
    def test_individuals_refined_and_kept_trees_have_their_spread_subtracted(self, opened):
        penalty = {"evaluation": {"episodes": 5, "std_penalty": 1.0}}
        problem = everything(opened, **penalty)
        state = last_state(problem, 5)
        seeds = training_seeds(problem.config, 4)
        fitness = measure(opened, state.population.forest, seeds, "test", 1.0)
        np.testing.assert_array_equal(fitness, state.population.fitness)
        without = measure(opened, state.population.forest, seeds, "test")
        assert (fitness <= without).all()
        assert (fitness < without).any()
        trees = Forest.stack([one.tree for one in state.archive.members])
        kept = measure(opened, trees, archive_seeds(problem.config), "test", 1.0)
        assert [one.archive_fitness for one in state.archive.members] == kept.tolist()

    def test_a_wild_refined_tree_does_not_take_a_steady_ones_place(self):
        """Its mean is higher, its fitness is not."""

        class Wild(Analytic):
            def evaluate(self, forest, seeds, purpose, *, visits=False):
                outcomes = super().evaluate(forest, seeds, purpose, visits=visits)
                wild = [
                    row for row in np.flatnonzero(forest.valid) if (forest.tree(row).threshold > 0.49).all()
                ]
                outcomes.returns[wild, ::2] += 30
                return outcomes

        def made_wild(tree):
            return tree.with_parameters(np.full(len(tree.parameters), 0.5, np.float32))

        for penalty, written in ((0.0, True), (5.0, False)):
            evaluation = {"episodes": 4, "std_penalty": penalty}
            problem = refining(Wild(lambda _: 1.0), Answers(made_wild), evaluation=evaluation)
            assert [event.written_back for event in run(problem, 3)[-1][1].refinements] == [written]
