from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from problems_for_tests import Nudge, cartpole, config_of, problem_of
from records_for_tests import generation

from ge_torchrl.run.costs import NOTHING, Cost
from ge_torchrl.run.remaining import Estimate, Pace, after_search, duration
from ge_torchrl.search.step import first_state


def record(number, elapsed, steps=1000):
    return generation(number, 1.0, steps=steps, elapsed_seconds=elapsed)


def estimates(numbers, *, share=1.0, after=0.0, refinement=NOTHING, refined=(), each=2.0, **limits):
    """Seconds left after generations of two seconds and 1000 steps, or ten times that where trees are refined."""
    schedule = {"every": 0, "generations": list(refined)}
    refiner = {"method": "ppo" if refined else "none", "schedule": schedule}
    settings = config_of(ge={"generations": 10, **limits}, refiner=refiner)
    estimate, elapsed, steps, left = Estimate(settings, share, refinement), 0.0, 0, []
    for number in range(numbers):
        times = 10 if number in refined else 1
        elapsed, steps = elapsed + times * each, steps + times * 1000
        made = generation(
            number, 1.0, elapsed_seconds=elapsed, evaluation_seconds=each, variation_seconds=0.0
        )
        left.append(estimate.seconds_left(replace(made, env_steps=steps), after))
    return left


def test_generations_to_come_last_as_long_as_those_so_far():
    assert estimates(10) == pytest.approx([18.0, 16.0, 14.0, 12.0, 10.0, 8.0, 6.0, 4.0, 2.0, 0.0])


def test_what_follows_the_search_is_part_of_it():
    assert estimates(10, after=5.0)[3::6] == pytest.approx([17.0, 5.0])


def test_no_more_than_the_limits_leave():
    assert estimates(4, max_seconds=10.0)[-1] == pytest.approx(2.0)
    assert estimates(4, max_env_steps=5000)[-1] == pytest.approx(2.0)
    assert estimates(4, max_env_steps=4000)[-1] == 0.0
    # The search ends where its share does.
    assert estimates(4, share=0.7, after=1.0, max_seconds=16.0)[-1] == pytest.approx(3.2 + 1.0)
    assert estimates(4, share=0.7, after=1.0, max_env_steps=10_000)[-1] == pytest.approx(6.0 + 1.0)
    assert estimates(4, share=0.7, after=9.0, max_seconds=16.0)[-1] == pytest.approx(8.0), "nor does the run"


def test_refinements_to_come_are_counted_before_the_first_of_them():
    guess = Cost(18.0, 9000)
    # Two of 20 s, the others of 2 s; what the first took counts for 14 s, since it loads PyTorch besides.
    assert estimates(10, refinement=guess, refined=[4, 8])[::4] == pytest.approx([54.0, 22.0, 2.0])
    # What they took replaces the guess.
    assert estimates(6, refinement=Cost(1.0, 1.0), refined=[4, 8])[-1] == pytest.approx(6.0 + 0.7 * 20.0)
    # Steps of the refinements use up the limit: 23,000 steps, of which 46 s are left after the first generation.
    assert estimates(1, refinement=guess, refined=[4, 8], max_env_steps=24_000)[0] == pytest.approx(
        54 * 23 / 27
    )


@given(st.integers(1, 10), st.floats(0, 1e6), st.floats(0.01, 1))
def test_it_is_never_negative(number, each, share):
    for limits in ({}, {"max_seconds": 5.0}, {"max_env_steps": 3000}):
        assert min(estimates(number, share=share, each=each, **limits)) >= 0.0


def test_one_generation_that_took_long_changes_little():
    settings = config_of(ge={"generations": 10}, refiner={"method": "none"})
    estimate, elapsed = Estimate(settings), 0.0
    for number, took in enumerate([2.0, 40.0, 2.0, 2.0]):
        elapsed += took
        left = estimate.seconds_left(record(number, elapsed))
    assert left == pytest.approx(12.0)


class TestAfterTheSearch:
    @staticmethod
    def searched(**archive):
        settings = {"keep": 2, "episodes": 10, "final_keep": 1, "final_factor": 20, **archive}
        backend = cartpole()
        try:
            problem = problem_of(backend, Nudge(backend), archive=settings, polish={"every": 1})
            return problem, first_state(problem)[0]
        finally:
            backend.close()

    def test_it_grows_with_what_the_refinement_of_a_tree_took(self):
        problem, state = self.searched()
        sizes = {member.tree.num_decision_nodes for member in state.archive.members} - {0}
        assert sizes
        state = replace(state, counts=replace(state.counts, refined=5))
        measuring = after_search(problem, state, 0.0)
        # A second a tree.
        assert after_search(problem, state, 5.0) - measuring == pytest.approx(0.28 * 20 * len(sizes))

    def test_a_polish_takes_its_whole_budget_at_the_speed_of_kept_trees(self):
        problem, state = self.searched()
        n_trees = len({member.tree.num_decision_nodes for member in state.archive.members} - {0})
        measuring = after_search(problem, state, 0.0)
        polishing = replace(problem, polisher=problem.refiner)
        budget = 20 * n_trees * problem.config.polish.max_timesteps
        speed = problem.config.evaluation.steps_per_second or problem.backend.steps_per_second
        assert after_search(polishing, state, 0.0) - measuring == pytest.approx(budget / speed)
        # A hundred times as fast as was thought at first.
        problem.backend.ledger.timed["archive"] = (int(1e4 * speed), 100.0)
        quick = after_search(polishing, state, 0.0)
        assert quick == pytest.approx((budget / speed + measuring) / 100)

    def test_validation_and_test_take_their_episodes(self):
        problem, state = self.searched()
        few = replace(problem.config.evaluation, validation_episodes=10, test_episodes=10)
        shorter = replace(problem, config=replace(problem.config, evaluation=few))
        assert 0 < after_search(shorter, state, 0.0) < after_search(problem, state, 0.0)


def test_the_pace_leaves_out_what_came_before_the_first_generation():
    # Compiling took 100 s.
    first, last = record(0, 101.0), record(4, 105.0)
    assert Pace.between(first, last) == Pace(1.0, 1000.0)


def test_the_first_generation_tells_by_its_own_clock():
    # Its rollouts and its variation took half a second.
    only = record(0, 101.0)
    assert Pace.between(only, only) == Pace(0.5, 2000.0)


@pytest.mark.parametrize(
    ("seconds", "text"), [(None, "-"), (0.0, "0:00"), (59.6, "1:00"), (3725.0, "1:02:05")]
)
def test_durations(seconds, text):
    assert duration(seconds) == text
