"""Restarts: several starts, one archive at last."""

import numpy as np
import pytest
from problems_for_tests import Nudge, problem_of
from states_for_tests import plain, rebuilt

from ge_torchrl.config import GEConfig
from ge_torchrl.errors import ConfigError
from ge_torchrl.search.restarts import begins_anew, goes_on_together, together
from ge_torchrl.search.step import first_state, step

ARCHIVE = {"keep": 2, "neighbours": 4, "revisit_factor": 5, "migrants": 2}


def problem(backend, restarts, generations=9):
    ge = {"generations": generations, "restarts": restarts}
    return problem_of(backend, None, Nudge(backend, "polish"), ge=ge, archive=ARCHIVE, polish={"every": 1})


def states(searched, start=None):
    state = first_state(searched)[0] if start is None else start
    yield state, False
    while state.generation + 1 < searched.config.ge.generations:
        state, events = step(searched, state)
        yield state, events.begins_anew


def test_generations_have_a_part_for_each_start_and_one_for_all_together():
    ge = GEConfig(generations=12, restarts=1)
    assert [g for g in range(12) if begins_anew(ge, g)] == [4]
    assert [g for g in range(12) if goes_on_together(ge, g)] == [8, 9, 10, 11]
    without = GEConfig(generations=12)
    assert not any(begins_anew(without, g) or goes_on_together(without, g) for g in range(12))


def test_a_start_knows_nothing_of_those_before_it_and_the_last_part_knows_all(opened):
    seen = list(states(problem(opened, restarts=1)))
    assert [state.generation for state, anew in seen if anew] == [3]
    before, anew, last = seen[2][0], seen[3][0], seen[6][0]
    assert anew.set_aside == (before.archive,)
    assert not anew.times_refined
    assert not np.array_equal(anew.population.codons, seen[0][0].population.codons)
    assert last.set_aside == ()
    assert last.archive.offered >= before.archive.offered | seen[5][0].archive.offered
    best = {
        size: max(
            member.archive_fitness
            for archive in (before.archive, seen[5][0].archive)
            for member in archive.of_size(size)
        )
        for size in {member.tree.num_decision_nodes for member in before.archive.members}
    }
    for size, fitness in best.items():
        assert last.archive.of_size(size)[0].archive_fitness >= fitness


def test_archives_together_keep_the_best_of_each_structure(opened):
    searched = problem(opened, restarts=1)
    apart = list(states(searched))[5][0]
    joined = together(searched, apart).archive
    members = [member for archive in (*apart.set_aside, apart.archive) for member in archive.members]
    for size in {member.tree.num_decision_nodes for member in members}:
        kept = joined.of_size(size)
        assert len({member.tree.structure for member in kept}) == len(kept) <= searched.config.archive.keep
        fitness = [member.archive_fitness for member in kept]
        assert fitness == sorted(fitness, reverse=True)
        assert fitness[0] == max(m.archive_fitness for m in members if m.tree.num_decision_nodes == size)
    assert together(searched, together(searched, apart)).archive.members == joined.members


def test_a_state_between_starts_goes_on_from_its_numbers_alone(opened):
    searched = problem(opened, restarts=1)
    seen = [state for state, _ in states(searched)]
    again = [state for state, _ in states(searched, rebuilt(plain(seen[4])))]
    assert plain(again[-1]) == plain(seen[-1])


def test_without_restarts_nothing_changes(opened):
    seen = [state for state, _ in states(problem(opened, restarts=0))]
    assert all(state.set_aside == () for state in seen)


def test_more_starts_than_generations_are_refused():
    with pytest.raises(
        ConfigError, match=r"^ge.restarts must be at most 3 with ge.generations=5, because each"
    ):
        GEConfig(generations=5, restarts=4)
