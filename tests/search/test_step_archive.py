"""What a generation gives to the archive, and what the archive gives back."""

import numpy as np
from generations_for_tests import ARCHIVE, everything, last_state, refining, run
from problems_for_tests import BAD, GOOD, Answers, moved_by, problem_of
from states_for_tests import told_apart

from ge_torchrl.ge.encoding import can_derive, snap
from ge_torchrl.run.recording import refinement_records
from ge_torchrl.search.archive import POLISH, POPULATION, REFINEMENT, digest
from ge_torchrl.search.population import next_population
from ge_torchrl.search.proposals import INDIVIDUAL, NEIGHBOUR
from ge_torchrl.search.step import step


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
