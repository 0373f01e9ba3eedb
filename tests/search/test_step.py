"""A generation as a function: state in, state out."""

import itertools

import numpy as np
import pytest
from generations_for_tests import EVERYTHING, everything, last_state, run
from problems_for_tests import Analytic, Noting, Nudge, cartpole, problem_of
from states_for_tests import plain, rebuilt, told_apart

from ge_torchrl.artefacts.records import CLOCK_FIELDS
from ge_torchrl.environments.backend import Limit, LimitReachedError
from ge_torchrl.run.recording import generation_record, refinement_records
from ge_torchrl.search.population import next_population
from ge_torchrl.search.step import first_state, step


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


class TestLedger:
    def test_every_step_is_counted_once(self, opened):
        steps = opened.steps.copy()
        backend = Noting(opened)
        state = last_state(everything(backend), 7)
        made = opened.steps - steps
        assert made == backend.counted
        assert {"training", "archive", "refinement", "polish", "measuring", "neighbours"} == set(made)
        assert state.counts.refined > 0
