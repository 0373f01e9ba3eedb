"""The loop over generations: what is shown, and what ends it."""

import numpy as np
import pytest
from problems_for_tests import GOOD, Analytic, Answers, Noting, Nudge, cartpole, leaf, problem_of
from states_for_tests import told_apart

from ge_torchrl.environments.backend import Limit, LimitReachedError
from ge_torchrl.run.loop import CALLBACK, SOLVING, Search
from ge_torchrl.search.step import first_state, step


@pytest.fixture(scope="module")
def opened():
    backend = cartpole()
    yield backend
    backend.close()


@pytest.fixture
def backend(opened):
    opened.limit = None
    yield Noting(opened)
    opened.limit = None


class Watched:
    """A search with its watcher, who may have something against going on."""

    def __init__(self, problem, in_generation=None, raises=None):
        self.states, self.events = [], []
        self._raises = in_generation, raises
        self.search = Search(problem, self._watch)

    def _watch(self, state, events):
        self.states.append(state)
        self.events.append(events)
        if state.generation == self._raises[0]:
            raise self._raises[1]

    def run(self):
        stopped_by = self.search.run()
        assert self.search.state is self.states[-1]
        return stopped_by

    @property
    def generations(self):
        return [state.generation for state in self.states]


def refining(backend, **ge):
    return problem_of(backend, Nudge(backend), ge=ge)


def test_every_generation_is_shown_and_the_last_state_kept(backend):
    problem = refining(backend)
    watched = Watched(problem)
    assert watched.run() == "generations"
    assert watched.generations == list(range(6))
    assert len(watched.events[4].refinements) == 1
    state, _ = first_state(problem)
    for shown in watched.states[1:]:
        state, _ = step(problem, state)
        assert told_apart(state) == told_apart(shown)


def test_a_search_of_one_generation_is_its_first_population(backend):
    watched = Watched(refining(backend, generations=1))
    assert watched.run() == "generations"
    assert watched.generations == [0]


def test_whoever_watches_may_stop_it(backend):
    search = Search(refining(backend), lambda state, _events: state.generation == 2)
    assert search.run() == CALLBACK
    assert search.state.generation == 2


def test_a_search_goes_on_from_a_state(backend):
    """Law 8, so far as it is the loop's."""
    problem = refining(backend)
    whole = Watched(problem)
    whole.run()
    for state in whole.states[:-1]:
        later = Watched(problem)
        later.search.state = state
        assert later.run() == "generations"
        assert later.generations == whole.generations[state.generation + 1 :]
        assert told_apart(later.search.state) == told_apart(whole.search.state)


class TestInterrupt:
    def test_it_keeps_the_generations_before_it(self, backend):
        watched = Watched(refining(backend), 3, KeyboardInterrupt())
        assert watched.run() == "interrupt"
        assert watched.generations == [0, 1, 2, 3]

    def test_in_a_refinement_it_leaves_the_state_before_the_generation(self, backend):
        def interrupted(_):
            raise KeyboardInterrupt

        watched = Watched(problem_of(backend, Answers(interrupted)))
        assert watched.run() == "interrupt"
        assert watched.generations == [0, 1]

    def test_before_the_first_generation_is_there_it_goes_on_up(self):
        class Interrupted(Analytic):
            def evaluate(self, *_, **__):
                raise KeyboardInterrupt

        watched = Watched(problem_of(Interrupted(None)))
        with pytest.raises(KeyboardInterrupt):
            watched.search.run()
        assert watched.search.state is None


class TestLimit:
    def test_it_ends_the_search_with_the_last_state(self, backend):
        watched = Watched(refining(backend))
        before = backend.steps.total()
        watched.run()
        half = (backend.steps.total() - before) // 2
        before = backend.steps.total()
        backend.limit = Limit(max_env_steps=before + half)
        limited = Watched(refining(backend))
        assert limited.run() == "max_env_steps"
        assert 1 <= len(limited.states) < 6
        for one, two in zip(limited.states, watched.states, strict=False):
            assert told_apart(one) == told_apart(two)
        assert half <= backend.steps.total() - before <= 1.1 * half

    def test_before_the_first_tree_is_measured_it_goes_on_up(self, backend):
        backend.limit = Limit(deadline=0.0)
        watched = Watched(refining(backend))
        with pytest.raises(LimitReachedError, match="max_seconds"):
            watched.search.run()
        assert watched.search.state is None


@pytest.mark.parametrize("fault", [RuntimeError("a plain bug"), OSError("disk full")])
def test_a_fault_goes_on_up_and_leaves_the_last_state(backend, fault):
    watched = Watched(refining(backend), 3, fault)
    with pytest.raises(type(fault)):
        watched.search.run()
    assert watched.search.state is watched.states[3]


class TestStopWhenSolved:
    @pytest.mark.parametrize(("refined", "stopped_by"), [(GOOD, "solved"), (leaf(0), "generations")])
    def test_a_refined_tree_stops_the_run_if_validation_agrees_that_it_solves(
        self, backend, refined, stopped_by
    ):
        """On a few measuring episodes a poor tree may look good."""
        problem = problem_of(
            backend,
            Answers(refined),
            refiner={"schedule": {"generations": [2]}, "write_back": False},
            ge={"stop_when_solved": True, "generations": 4},
            evaluation={"validation_episodes": 10},
        )
        watched = Watched(problem)
        assert watched.run() == stopped_by
        assert len(watched.states) == (3 if stopped_by == "solved" else 4)
        assert (backend.counted[SOLVING] >= 4500) == (stopped_by == "solved")

    def test_an_individual_does_and_each_tree_is_asked_once(self):
        returns = {"training": 10.0, SOLVING: 1.0}

        class TwoFaced(Analytic):
            def evaluate(self, forest, seeds, purpose, *, visits=False):
                outcomes = super().evaluate(forest, seeds, purpose, visits=visits)
                outcomes.returns[forest.valid] = returns[purpose]
                return outcomes

        backend = TwoFaced(lambda _: 0.0, solved_at=5.0)
        settings = {"stop_when_solved": True, "parsimony": "none"}
        watched = Watched(problem_of(backend, ge=settings))
        assert watched.run() == "generations"
        assert backend.purposes.count(SOLVING) == 1, "the best tree stays the same, so it is not asked again"
        returns[SOLVING] = 5.0
        assert Watched(problem_of(backend, ge=settings)).run() == "solved"

    def test_without_a_threshold_or_without_being_asked_nothing_is_validated(self, backend):
        Watched(refining(backend)).run()
        assert SOLVING not in backend.counted
        untold = Analytic(lambda _: 1e9)
        assert Watched(problem_of(untold, ge={"stop_when_solved": True})).run() == "generations"
        assert SOLVING not in untold.purposes

    def test_an_invalid_population_is_never_asked(self, backend):
        problem = problem_of(backend, ge={"stop_when_solved": True, "genotype_length": 2})
        watched = Watched(problem)
        assert watched.run() == "generations"
        assert not np.isfinite(watched.states[-1].population.fitness).any()
