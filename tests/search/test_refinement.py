"""A generation's proposals through refiner and polish: what is accepted, what is measured, what is told."""

import math

import numpy as np
import pytest
from problems_for_tests import (
    BAD,
    GOOD,
    POOR,
    Analytic,
    Answers,
    leaf,
    moved_by,
    problem_of,
    split,
)

from ge_torchrl.ge.encoding import snap
from ge_torchrl.refiners.protocol import FIRST, Effort
from ge_torchrl.search.fitness import measure, training_seeds
from ge_torchrl.search.proposals import INDIVIDUAL, KEPT, NEIGHBOUR, Proposal
from ge_torchrl.search.refinement import (
    FAILED,
    IMPROVED,
    MEASURING,
    NOT_IMPROVED,
    is_clearly_better,
    refine_proposals,
    refine_with_effort,
)
from ge_torchrl.trees.forest import Forest

# The refiner is due in every second generation, a polish in every third.
REFINES, POLISHES, BOTH, NEITHER = 2, 3, 6, 1
TESTS_POSITION = split(0, 0.0, split(3, 0.1, leaf(0), leaf(1)), leaf(1))


def refine(backend, answers, trees, generation=REFINES, polishes=None, evaluation=(), **refiner):
    problem = problem_of(
        backend,
        answers,
        polishes,
        refiner={"measuring_episodes": 10, "write_back": False, **refiner},
        polish={"every": 3 if polishes else 0},
        evaluation=dict(evaluation),
    )
    proposals = [
        tree if isinstance(tree, Proposal) else Proposal(tree, INDIVIDUAL, 9.0, individual=place)
        for place, tree in enumerate(trees)
    ]
    return problem, refine_proposals(problem, proposals, generation)


def refine_one(*args, **settings):
    return refine(*args, **settings)[1].refinements[0]


def test_better_by_so_many_standard_errors():
    # Differences 0, 2, 0, 2: mean 1, deviation 1, standard error 1/2.
    returns, than = np.array([1.0, 3.0, 1.0, 3.0]), np.ones(4)
    assert is_clearly_better(returns, than, 0.0)
    assert is_clearly_better(returns, than, 1.9)
    assert not is_clearly_better(returns, than, 2.0)
    assert not is_clearly_better(than, than, 0.0), "equal is not better"
    assert not is_clearly_better(than, returns, 0.0)


@pytest.mark.parametrize(
    ("before", "answer", "episodes", "after", "outcome"),
    [
        (BAD, GOOD, 0, GOOD, IMPROVED),
        (BAD, GOOD, 30, GOOD, IMPROVED),
        (GOOD, BAD, 0, BAD, NOT_IMPROVED),
        (GOOD, BAD, 30, GOOD, NOT_IMPROVED),
        (GOOD, GOOD, 30, GOOD, NOT_IMPROVED),
    ],
)
def test_what_is_not_better_comes_back_as_it_was_where_acceptance_asks(
    backend, before, answer, episodes, after, outcome
):
    one = refine_one(backend, Answers(answer), [before], acceptance_episodes=episodes)
    assert (one.refined, one.tree, one.outcome, one.is_changed) == (after, after, outcome, after != before)
    assert (one.fitness_before == one.fitness_after) == (after == before)
    assert (one.snapped, one.fitness_snapped, one.training.timesteps) == (None, None, 100)


def test_so_many_episodes_accept_others_measure_and_the_generations_own_tell_the_fitness(backend):
    problem, _ = refine(backend, Answers(GOOD), [BAD], acceptance_episodes=30)
    accepting, measuring, training = backend.seeds
    assert (len(accepting), len(measuring)) == (30, 10)
    assert not set(accepting) & set(measuring)
    assert training == training_seeds(problem.config, REFINES).tolist()
    assert backend.batches == [(2, MEASURING), (2, MEASURING), (1, MEASURING)]
    backend.seeds.clear()
    refine(backend, Answers(BAD), [BAD], acceptance_episodes=30)
    assert len(backend.seeds) == 2, "a tree that did not change is not asked whether it is better"


def test_all_proposals_are_one_batch(backend):
    answers = Answers(lambda tree: {BAD: GOOD, GOOD: BAD}[tree])
    _, refinements = refine(backend, answers, [BAD, GOOD, BAD], acceptance_episodes=30)
    assert [one.refined for one in refinements.refinements] == [GOOD, GOOD, GOOD]
    assert [one.outcome for one in refinements.refinements] == [IMPROVED, NOT_IMPROVED, IMPROVED]
    assert [trees for trees, _ in answers.asked] == [[BAD, GOOD, BAD]]
    assert [n_trees for n_trees, _ in backend.batches] == [6, 6, 3]


def test_trees_of_one_effort_are_refined_in_one_call_each_with_a_stream_of_its_own(opened):
    asked = []

    class Draws(Answers):
        def refine(self, trees, rngs, effort=FIRST):
            asked.append((effort, [rng.random() for rng in rngs]))
            return super().refine(trees, rngs, effort)

    proposals = [
        Proposal(BAD, INDIVIDUAL, 9.0, individual=0),
        Proposal(GOOD, KEPT, 9.0, effort=Effort(5)),
        Proposal(BAD, NEIGHBOUR, 9.0),
    ]
    _, refinements = refine(opened, Draws(), proposals)
    assert [(effort, len(draws)) for effort, draws in asked] == [(FIRST, 2), (Effort(5), 1)]
    assert len({draw for _, draws in asked for draw in draws}) == 3
    assert [one.proposal for one in refinements.refinements] == proposals
    first = list(asked)
    asked.clear()
    refine(opened, Draws(), proposals)
    assert asked == first, "the generation and the place find a stream"
    asked.clear()
    refine(opened, Draws(), proposals, generation=REFINES + 2)
    assert not {draw for _, draws in asked for draw in draws} & {draw for _, draws in first for draw in draws}


def test_steadier_but_not_better_on_average_is_not_accepted_and_better_but_wilder_neither():
    """With a penalty a tree is accepted only where its fitness is higher too."""
    returns = {BAD: [10.0, 10.0], GOOD: [11.0, 40.0]}

    class Wild(Analytic):
        def evaluate(self, forest, seeds, purpose, *, visits=False):
            outcomes = super().evaluate(forest, seeds, purpose, visits=visits)
            for row, tree in enumerate(forest.trees()):
                outcomes.returns[row] = np.resize(returns[tree], len(seeds))
            return outcomes

    settings = {"acceptance_episodes": 30}
    for penalty, accepted in ((0.0, GOOD), (0.5, GOOD), (2.0, BAD)):
        evaluation = {"std_penalty": penalty}
        wild = Wild(lambda _: 0.0)
        assert refine_one(wild, Answers(GOOD), [BAD], evaluation=evaluation, **settings).refined == accepted
        assert refine_one(wild, Answers(BAD), [GOOD], evaluation=evaluation, **settings).refined == GOOD


def test_refined_trees_are_told_on_the_scale_of_the_population(backend):
    problem, refinements = refine(backend, Answers(POOR), [BAD], evaluation={"std_penalty": 1.5})
    (one,) = refinements.refinements
    measuring, training = map(np.array, backend.seeds)
    assert training.tolist() == training_seeds(problem.config, REFINES).tolist()
    for tree, seeds, fitness in (
        (POOR, training, one.fitness),
        (POOR, measuring, one.fitness_after),
        (BAD, measuring, one.fitness_before),
    ):
        assert fitness == measure(backend, Forest.stack([tree]), seeds, "test", 1.5)[0]
        assert fitness < measure(backend, Forest.stack([tree]), seeds, "test")[0]


def test_a_failed_training_is_told(backend):
    one = refine_one(backend, Answers(BAD, failure="the loss is not finite"), [BAD])
    assert (one.outcome, one.training.failure) == (FAILED, "the loss is not finite")


def test_with_write_back_trees_are_snapped_and_measured_so_too(backend):
    problem, refinements = refine(backend, Answers(GOOD), [BAD], write_back=True)
    (one,) = refinements.refinements
    snapped = snap(GOOD, problem.tables.grammar)
    assert (one.refined, one.tree) == (GOOD, snapped)
    assert snapped != GOOD
    (fitness,) = measure(backend, Forest.stack([snapped]), np.array(backend.seeds[0]), "test")
    assert (one.snapped, one.fitness_snapped) == (snapped, fitness)


def test_what_the_grammar_cannot_say_stays_as_it_is(backend):
    one = refine_one(backend, Answers(TESTS_POSITION), [BAD], write_back=True)
    assert one.tree == one.refined == TESTS_POSITION
    assert (one.snapped, one.fitness_snapped) == (None, None)


class TestPolish:
    def test_it_goes_on_from_what_the_refiner_found(self, backend):
        refiner, polisher = Answers(GOOD), Answers(moved_by(0.01))
        _, refinements = refine(backend, refiner, [BAD], BOTH, polisher)
        (one,) = refinements.refinements
        assert polisher.trees == [GOOD]
        assert (one.refined, one.tree) == (GOOD, moved_by(0.01)(GOOD))
        assert (one.outcome, refinements.polished) == (IMPROVED, 1)
        assert refinements.polish_seconds > 0

    def test_each_is_asked_only_where_it_is_due(self, backend):
        for generation, refines, polishes in (
            (NEITHER, 0, 0),
            (REFINES, 1, 0),
            (POLISHES, 0, 1),
            (BOTH, 1, 1),
        ):
            refiner, polisher = Answers(), Answers()
            _, refinements = refine(backend, refiner, [BAD], generation, polisher)
            (one,) = refinements.refinements
            assert (len(refiner.asked), len(polisher.asked)) == (refines, polishes)
            assert (one.training is not None, refinements.polished) == (bool(refines), polishes)
            assert math.isnan(one.fitness_before) == (not refines)
            assert (one.outcome is None) == (not refines)

    def test_its_draws_are_others_than_the_refiners(self, backend):
        drawn = []

        class Draws(Answers):
            def refine(self, trees, rngs, effort=FIRST):
                drawn.extend(rng.random() for rng in rngs)
                return super().refine(trees, rngs, effort)

        refine(backend, Draws(), [BAD, GOOD], BOTH, Draws())
        assert len(set(drawn)) == 4


def test_no_proposals_cost_nothing(backend):
    _, refinements = refine(backend, Answers(), [])
    assert (refinements.refinements, refinements.polished, backend.batches) == ((), 0, [])


@pytest.mark.parametrize("write_back", [True, False])
def test_with_more_effort_trees_come_back_snapped_where_they_are_written_back(opened, write_back):
    problem = problem_of(opened, refiner={"write_back": write_back})
    answers = Answers(GOOD)
    effort = Effort(3, 2, 0.1)
    (tree,) = refine_with_effort(problem, answers, [BAD], effort, "a name")
    assert answers.asked == [([BAD], effort)]
    assert tree == (snap(GOOD, problem.tables.grammar) if write_back else GOOD)
