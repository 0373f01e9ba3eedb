"""A generation as a function: state in, state out."""

import itertools

import numpy as np
import pytest
from problems_for_tests import (
    BAD,
    GOOD,
    Analytic,
    Answers,
    Noting,
    Nudge,
    cartpole,
    leaf,
    moved_by,
    problem_of,
    split,
)
from states_for_tests import plain, rebuilt, told_apart

from ge_torchrl.artefacts.records import CLOCK_FIELDS
from ge_torchrl.environments.backend import Limit, LimitReachedError
from ge_torchrl.ge.encoding import can_derive, snap
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.run.recording import generation_record, refinement_records
from ge_torchrl.search.archive import POLISH, POPULATION, REFINEMENT, digest
from ge_torchrl.search.fitness import archive_seeds, measure, training_seeds
from ge_torchrl.search.population import map_simplified, next_population
from ge_torchrl.search.proposals import INDIVIDUAL, NEIGHBOUR
from ge_torchrl.search.refinement import FAILED, IMPROVED, NOT_IMPROVED
from ge_torchrl.search.step import first_state, step
from ge_torchrl.trees.forest import Forest

EVERYTHING = {
    "refiner": {"schedule": {"every": 2}, "candidates": 2, "acceptance_episodes": 5, "measuring_episodes": 5},
    "polish": {"every": 3},
    "archive": {
        "keep": 3,
        "episodes": 20,
        "neighbours": 4,
        "revisit_factor": 2,
        "migrants": 4,
    },
}
ARCHIVE = {**EVERYTHING["archive"], "neighbours_drawn": 40, "max_nodes": 5}


@pytest.fixture(scope="module")
def opened():
    backend = cartpole()
    yield backend
    backend.close()


def everything(backend, **changes):
    """Return a problem in which all that a generation can do is done."""
    return problem_of(backend, Nudge(backend), Nudge(backend, "polish"), **{**EVERYTHING, **changes})


def run(problem, n):
    """Return the states and events of `n` generations."""
    found = [first_state(problem)]
    while len(found) < n:
        found.append(step(problem, found[-1][0]))
    return found


def last_state(problem, n):
    return run(problem, n)[-1][0]


def records_of(state, events):
    records = [generation_record(state, events, 0, 0.0), *refinement_records(state, events)]
    return [{k: v for k, v in vars(one).items() if k not in CLOCK_FIELDS} for one in records]


class TestFunction:
    def test_a_state_is_plain_and_what_goes_in_stays_as_it_was_to_the_byte(self, opened):
        problem = everything(opened)
        state, _ = first_state(problem)
        for _ in range(6):
            before = told_apart(state)
            after, _ = step(problem, state)
            assert told_apart(state) == before
            state = after
        assert state.counts.refined > 0 < state.counts.polished

    def test_the_same_state_twice_gives_the_same_next_state_events_and_records(self, opened):
        problem = everything(opened)
        for state, _ in run(problem, 7):
            one, two = step(problem, state), step(problem, state)
            assert told_apart(one) == told_apart(two)
            assert records_of(*one) == records_of(*two)

    @pytest.mark.parametrize("mode", ["common", "fixed", "fresh"])
    def test_nothing_outside_the_state_is_carried(self, opened, mode):
        """A state that a file gave back, a problem made anew, another backend: the search goes on the same."""
        settings = {"evaluation": {"episodes": 3, "episode_seeds": mode}}
        states = run(everything(opened, **settings), 7)
        for (state, _), expected in itertools.pairwise(states):
            read = rebuilt(plain(state))
            assert read.population.codons is not state.population.codons
            backend = cartpole()
            after = step(everything(backend, **settings), read)
            backend.close()
            assert told_apart(after) == told_apart(expected)

    def test_threads_do_not_show(self, opened):
        """Law 6."""
        two_threads = cartpole(threads=2)
        for one, two in zip(run(everything(opened), 7), run(everything(two_threads), 7), strict=True):
            assert told_apart(one) == told_apart(two)
        two_threads.close()

    def test_another_seed_is_another_search(self, opened):
        one, two = (last_state(everything(opened, seed=seed), 3) for seed in (0, 1))
        assert told_apart(one.population) != told_apart(two.population)


class TestRandomnessByName:
    def test_a_generation_that_refines_nothing_leaves_the_draws_of_the_next_as_they_are(self, opened):
        """Selection and variation of generation 3 do not know what generation 2 drew."""
        kept_apart = {"refiner": {**EVERYTHING["refiner"], "write_back": False}, "archive": {}}
        refined = problem_of(opened, Nudge(opened), **kept_apart, polish={"every": 0})
        never = problem_of(opened, **kept_apart, polish={"every": 0})
        for (one, _), (two, _) in zip(run(refined, 6), run(never, 6), strict=True):
            assert told_apart(one.population) == told_apart(two.population)
        assert one.counts.refined > 0 == two.counts.refined

    def test_from_one_state_the_same_offspring_are_born_whatever_came_before(self, opened):
        problem = everything(opened)
        state = last_state(problem, 3)
        evolved = next_population(problem, state.population, 3).population
        quiet = everything(opened, refiner={**EVERYTHING["refiner"], "schedule": {"every": 50}})
        born = next_population(quiet, state.population, 3).population
        assert told_apart(evolved) == told_apart(born)

    def test_the_archive_alone_changes_nothing_in_the_population(self, opened):
        keeps, plain_ge = problem_of(opened, archive={"keep": 3}), problem_of(opened)
        for (one, _), (two, _) in zip(run(keeps, 5), run(plain_ge, 5), strict=True):
            assert told_apart(one.population) == told_apart(two.population)
        assert len(one.archive.members) > 0 == len(two.archive.members)


class TestLimit:
    @pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
    def test_a_step_that_a_limit_breaks_off_has_not_happened(self, opened, share):
        backend = Noting(opened)
        problem = everything(backend)
        state = last_state(problem, 6)
        before, steps = told_apart(state), backend.steps.total()
        expected = step(problem, state)
        needed = backend.steps.total() - steps
        backend.limit = Limit(max_env_steps=backend.steps.total() + int(share * needed))
        try:
            with pytest.raises(LimitReachedError):
                step(problem, state)
        finally:
            backend.limit = None
        assert told_apart(state) == before
        assert told_apart(step(problem, state)) == told_apart(expected)

    def test_a_limit_within_the_first_generation_leaves_what_was_measured(self):
        backend = Analytic(lambda tree: float(tree.num_leaves))
        problem = problem_of(backend, archive={"keep": 3}, ge={"population_size": 80})
        backend.limit = Limit(max_env_steps=1500)
        state, events = first_state(problem)
        assert state.archive.members == ()
        assert np.isfinite(state.population.fitness).any()
        assert (state.counts.born, events.born) == (80, 80)


class Script:
    """Answers generation after generation with what the test wrote down."""

    def __init__(self, *answers):
        self._answers = list(answers)
        self.asked = []

    def refine(self, trees, rngs, effort):
        self.asked.append(list(trees))
        return self._answers.pop(0).refine(trees, rngs, effort)


def refining(backend, *answers, **changes):
    """Return a problem whose refiner, every second generation, answers so; nothing else goes on."""
    sections = {"refiner": {"schedule": {"every": 2}, "measuring_episodes": 5, "acceptance_episodes": 0}}
    for name, values in changes.items():
        sections[name] = {**sections.get(name, {}), **values}
    return problem_of(backend, Script(*answers), **sections)


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


class TestArchive:
    def test_it_is_offered_the_leaders_and_what_was_refined_each_by_its_origin(self, opened):
        problem = refining(opened, Answers(GOOD), Answers(BAD), archive={"keep": 3, "episodes": 20})
        state, events = run(problem, 3)[-1]
        snapped = snap(GOOD, problem.tables.grammar)
        origins = {digest(one.tree): one.origin for one in state.archive.members}
        assert events.refinements[0].written_back
        assert origins[digest(snapped)] == REFINEMENT, "that it was written back does not make it evolution's"
        for size in np.unique(state.population.sizes[np.isfinite(state.population.fitness)]):
            if size <= problem.config.archive.max_nodes:
                assert state.archive.of_size(int(size))

    def test_what_only_the_polish_changed_is_the_polishs_and_what_nothing_changed_is_evolutions(self, opened):
        for refines, polishes, origin in (
            (Answers(), None, POPULATION),
            (Answers(), Answers(), POPULATION),
            (Answers(), Answers(GOOD), POLISH),
            (None, Answers(GOOD), POLISH),
            (Answers(GOOD), Answers(moved_by(0.02)), REFINEMENT),
        ):
            problem = problem_of(
                opened,
                refines,
                polishes,
                refiner={"measuring_episodes": 5},
                polish={"every": 2},
                archive={"keep": 9, "episodes": 20},
            )
            state, _ = run(problem, 3)[-1]
            origins = {one.origin for one in state.archive.members}
            assert origins == {POPULATION, origin}

    def test_neighbours_and_kept_trees_are_refined_with_the_individuals_in_one_batch_for_each_effort(
        self, opened
    ):
        problem = everything(opened)
        *_, (state, events) = run(problem, 3)
        origins = [event.refinement.proposal.origin for event in events.refinements]
        assert origins == [INDIVIDUAL] * 2 + [NEIGHBOUR] * 4 + ["archive"]
        (first, revisited) = problem.refiner.asked
        assert (len(first[0]), len(revisited[0])) == (6, 1)
        assert (first[1].factor, revisited[1].factor) == (1, 2)
        assert (state.counts.refinements, state.counts.refined, state.counts.polished) == (2, 7, 0)
        for record in refinement_records(state, events)[2:]:
            assert (record.individual, record.chosen, record.written_back) == (None, None, False)

    def test_migrants_take_the_places_of_the_least_fit_and_never_of_fitter_ones(self, opened):
        quiet = {"neighbours": 0, "revisit_factor": 0}
        problem = everything(opened, archive={**ARCHIVE, **quiet, "migrants": 6}, polish={"every": 0})
        without = everything(opened, archive={**ARCHIVE, **quiet, "migrants": 0}, polish={"every": 0})
        after, stayed = last_state(problem, 3), last_state(without, 3)
        least = np.argsort(stayed.population.fitness, kind="stable")[:6]
        changed = np.flatnonzero((after.population.codons != stayed.population.codons).any(axis=1))
        assert len(changed) > 0
        assert set(changed) <= set(least)
        assert (after.population.fitness[changed] > stayed.population.fitness[changed]).all()
        kept = {snap(one.tree, problem.tables.grammar) for one in after.archive.members
                if can_derive(one.tree, problem.tables)}  # fmt: skip
        for slot in changed:
            assert after.population.forest.tree(slot) in kept

    def test_where_nothing_is_due_nobody_migrates_and_nothing_is_proposed(self, opened):
        problem = everything(opened)
        state = last_state(problem, 1)
        after, events = step(problem, state)
        evolved = next_population(problem, state.population, 1).population
        assert told_apart(after.population) == told_apart(evolved)
        assert (events.refinements, events.redraws, after.counts.polished) == ((), None, 0)


class TestLedger:
    def test_every_step_is_counted_once(self, opened):
        steps = opened.steps.copy()
        backend = Noting(opened)
        state = last_state(everything(backend), 7)
        made = opened.steps - steps
        assert made == backend.counted
        assert {"training", "archive", "refinement", "polish", "measuring", "neighbours"} == set(made)
        assert state.counts.refined > 0
