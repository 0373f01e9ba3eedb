"""Kept trees are refined once more at the end of a search."""

from dataclasses import replace

import numpy as np
import pytest
from problems_for_tests import (
    GOOD,
    POOR,
    POOR_MOVED,
    POORER,
    Analytic,
    Answers,
    Nudge,
    contender,
    leaf,
    moved_by,
    problem_of,
    split,
)

from ge_torchrl.environments.backend import Limit, LimitReachedError
from ge_torchrl.ge.encoding import snap
from ge_torchrl.refiners.protocol import Effort
from ge_torchrl.search.archive import ARCHIVE, REFINEMENT, Archive, offer
from ge_torchrl.search.conclusion import (
    FINAL,
    refine_once_more,
)
from ge_torchrl.search.step import first_state
from ge_torchrl.trees.forest import Forest


class TestOnceMore:
    SETTINGS = {"keep": 3, "final_keep": 1, "final_factor": 3, "final_patience": 2, "final_step": 0.1}  # noqa: RUF012

    def problem(self, backend, refines, polishes=None, settling=0, *, write_back=False, **archive):
        return problem_of(
            backend,
            refines,
            polishes,
            archive={**self.SETTINGS, **archive},
            refiner={"write_back": write_back},
            polish={"every": 1, "settling_episodes": settling},
        )

    @staticmethod
    def state(problem, *kept):
        state, _ = first_state(problem)
        archive = offer(problem, Archive(), [contender(tree) for tree in kept])
        return replace(state, archive=archive)

    def test_the_best_of_each_size_are_refined_with_the_effort_of_the_end(self, backend):
        answers = Answers()
        problem = self.problem(backend, answers)
        state = self.state(problem, GOOD, POOR, POORER, leaf(0))
        refine_once_more(problem, state)
        ((trees, effort),) = answers.asked
        assert trees == [POOR, GOOD], "a lone leaf has nothing to refine"
        assert effort == Effort(3, 2, 0.1)

    def test_the_polisher_does_it_where_there_is_one(self, backend):
        refiner, polisher = Answers(), Answers()
        problem = self.problem(backend, refiner, polisher)
        refine_once_more(problem, self.state(problem, GOOD))
        assert (refiner.asked, len(polisher.asked)) == ([], 1)

    def test_what_comes_out_is_offered_and_counted(self, backend):
        problem = self.problem(backend, Answers({POOR: GOOD}.get), max_nodes=2)
        state = self.state(problem, POOR)
        before = backend.counted.copy()
        after = refine_once_more(problem, state)
        assert [one.tree for one in after.archive.members] == [POOR, GOOD]
        assert after.archive.of_size(2)[0].origin == REFINEMENT, "it is the refiner, since there is no polish"
        assert [one.tree for one in state.archive.members] == [POOR]
        assert set(backend.counted - before) == {FINAL, ARCHIVE}
        assert after.population is state.population

    def test_nothing_is_done_where_nothing_is_asked_for(self, backend):
        for problem in (self.problem(backend, Answers(), final_keep=0), self.problem(backend, None)):
            state = self.state(problem, POOR)
            assert refine_once_more(problem, state) is state
        problem = self.problem(backend, Answers())
        assert refine_once_more(problem, self.state(problem)).archive.members == ()

    @pytest.mark.parametrize(("write_back", "episodes"), [(True, 40), (True, 0), (False, 40)])
    def test_snapped_numbers_are_moved_to_better_constants_near_by(self, backend, write_back, episodes):
        problem = self.problem(backend, Answers(moved_by(0.003)), settling=episodes, write_back=write_back)
        state = self.state(problem, POOR)
        backend.batches.clear()
        after = refine_once_more(problem, state)
        # All trees that differ in the one threshold by up to four constants are tried.
        assert ((6, FINAL) in backend.batches) == (write_back and episodes > 0)
        for one in after.archive.members:
            assert (snap(one.tree, problem.tables.grammar) == one.tree) >= write_back

    def test_a_limit_keeps_what_was_refined_before_it(self):
        backend = Analytic(lambda _: 1.0)

        class Dear(Answers):
            def refine(self, trees, rngs, effort):
                backend.evaluate(Forest.stack(trees), np.arange(50), "refinement")
                return super().refine(trees, rngs, effort)

        refiner = Dear(moved_by(0.003))
        problem = self.problem(backend, refiner, keep=9, final_keep=9)
        # Of one structure each, so that all are kept.
        kept = [split(f, 0.0, leaf(a), leaf(1 - a)) for f in range(4) for a in range(2)]
        state = self.state(problem, *kept)
        whole = refine_once_more(problem, state)
        needed = backend.steps.total()
        refine_once_more(problem, state)
        needed = backend.steps.total() - needed
        refiner.asked.clear()
        backend.limit = Limit(max_env_steps=backend.steps.total() + int(0.9 * needed))
        part = refine_once_more(problem, state)
        assert [len(trees) for trees, _ in refiner.asked] == [4, 4]
        new = part.archive.offered - state.archive.offered
        assert 0 < len(new) < len(whole.archive.offered - state.archive.offered)

    def test_a_limit_that_is_reached_already_changes_nothing(self, backend):
        problem = self.problem(backend, Nudge(backend))
        state = self.state(problem, POOR, POOR_MOVED)
        backend.limit = Limit(max_env_steps=1)
        assert refine_once_more(problem, state) is state
        with pytest.raises(LimitReachedError):
            problem.refiner.refine([POOR], [np.random.default_rng(0)])
