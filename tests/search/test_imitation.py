"""Imitation: trees of a grammar without sums come near to a rule of sums, and nearer once their thresholds moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from mirrors_for_tests import MIRRORS
from problems_for_tests import Analytic, config_of, problem_of
from strategies import trees

from ge_torchrl.environments.backend import Limit
from ge_torchrl.ge.encoding import can_derive
from ge_torchrl.refiners.folding import half_of
from ge_torchrl.search import imitation
from ge_torchrl.search.archive import START, Archive, offer
from ge_torchrl.search.climbing import Climbers, climb
from ge_torchrl.search.imitation import clearness, imitations
from ge_torchrl.search.population import first_population
from ge_torchrl.search.starts import STARTS, dense_starts
from ge_torchrl.trees.tree import DecisionTree

CART = MIRRORS["cart"]
GOAL = np.array([0.3, 0.2, 2.0, 1.0])
STATES = np.random.default_rng(0).normal(size=(300, 4)).astype(np.float32)
RULE = DecisionTree.weighted_split(range(4), GOAL, 0.0, DecisionTree.leaf(0), DecisionTree.leaf(1))
BNF = """
<if>        ::= if <condition> then <action> else <action>
<condition> ::= lt(<feature>, [-3, 3] step 0.01)
<feature>   ::= x | x_dot | theta | theta_dot
<action>    ::= left | right | <if>
"""


def value(tree):
    """How often it does what the rule does, in percent."""
    return 100 * float((tree.decide(STATES) == RULE.decide(STATES)).mean())


def problem(mirrored=True, races=2, bnf=BNF, **starts):
    config = config_of(
        grammar={"name": "all", "bnf": bnf}, archive={"keep": 3, "max_nodes": 7, "races": races}
    )
    config = replace(
        config, starts=replace(config.starts, **{"races": 1, "count": 4, "max_timesteps": 60_000, **starts})
    )
    backend = Analytic(value, luck=1.0)
    return replace(problem_of(backend, config=config), mirror=CART if mirrored else None)


def imitated(problem, timesteps=60_000, seed=0):
    return imitations(problem, RULE, timesteps, STARTS, np.random.default_rng(seed))


@pytest.mark.parametrize("mirrored", [True, False])
def test_over_seeds_it_does_mostly_what_the_rule_does(mirrored):
    best = [imitated(problem(mirrored), seed=seed)[0] for seed in range(4)]
    # One split, of the feature that weighs most, does it in 80 %.
    assert np.median([value(tree) for tree in best]) > 86
    for tree in best:
        assert tree.is_axis_aligned
        assert tree.num_decision_nodes <= 7


@pytest.mark.parametrize("seed", range(3))
def test_in_a_mirror_it_is_its_own_image_and_the_grammar_says_it(seed):
    of = problem()
    for tree in imitated(of, seed=seed):
        assert half_of(tree, CART) is not None
        assert can_derive(tree, of.tables)


@pytest.mark.parametrize(
    ("action", "mirrored", "most"),
    [
        ("left | right", False, 1),
        ("left | right", True, 1),
        ("left | right | if <condition> then <leaf> else <leaf>\n<leaf> ::= left | right", False, 3),
    ],
)
def test_where_the_grammar_says_few_splits_it_has_as_few(action, mirrored, most):
    """What is fitted with more of them is nothing that the grammar could say."""
    of = problem(mirrored, bnf=BNF.replace("left | right | <if>", action))
    for tree in imitated(of):
        assert tree.num_decision_nodes <= most
        assert can_derive(tree, of.tables)
    assert value(imitated(of)[0]) > 70


def test_where_the_grammar_says_nothing_like_it_nothing_comes_of_it():
    one_split = BNF.replace("left | right | <if>", "left | right").replace(
        "x | x_dot | theta | theta_dot", "theta"
    )
    of = problem(bnf=one_split)
    assert all(can_derive(tree, of.tables) for tree in imitated(of, 20_000))


def test_the_same_randomness_gives_the_same_trees():
    assert imitated(problem(), 20_000) == imitated(problem(), 20_000)
    assert imitated(problem(), 20_000) != imitated(problem(), 20_000, seed=1)


def test_moving_thresholds_makes_what_was_fitted_better(monkeypatch):
    fitted = []
    fit = imitation._fitted
    monkeypatch.setattr(imitation, "_fitted", lambda *args: fitted.append(fit(*args)) or fitted[-1])
    gained = [value(imitated(problem(), seed=seed)[0]) - value(fitted[-1][0]) for seed in range(4)]
    assert np.median(gained) > 0


def test_steps_are_counted_and_about_as_many_as_asked():
    of = problem()
    imitated(of, 60_000)
    assert set(of.backend.steps) == {STARTS}
    assert 40_000 < of.backend.steps.total() < 80_000


@pytest.mark.parametrize("most", [50, 5_000, 20_000, 45_000])
def test_where_a_limit_breaks_it_off_what_there_is_comes_back(most):
    of = problem()
    of.backend.limit = Limit(max_env_steps=most)
    found = imitated(of)
    # A batch that reaches the limit is counted whole.
    assert of.backend.steps.total() < most + 15_000
    if most > 5_000:
        assert found
        assert max(map(value, found)) > 70


class TestStarts:
    def starts(self, of, generation=1):
        return dense_starts(of, first_population(of).population, generation)

    def test_where_steps_are_dear_a_rule_is_found_and_imitated(self):
        of = problem()
        contenders = self.starts(of)
        assert contenders
        for one in contenders:
            assert one.origin == START
            assert one.tree.is_axis_aligned
        assert max(value(one.tree) for one in contenders) > 80
        # As many for the rule as for its imitations.
        assert 80_000 < of.backend.steps[STARTS] < 160_000
        assert self.starts(of, generation=2) == []

    def test_where_they_are_nearly_free_there_is_none(self):
        of = problem(races=0)
        assert self.starts(of) == []
        assert of.backend.steps[STARTS] == 0

    def test_who_climbs_begins_at_what_came_of_it(self):
        of = problem()
        archive = offer(of, Archive(), self.starts(of))
        best = max(archive.members, key=lambda member: member.archive_fitness)
        _, climbers = climb(of, archive, Climbers(), 2)
        assert value(climbers.climber.tree) >= value(best.tree) - 1


class TestClearness:
    def test_what_is_near_a_threshold_is_less_clear(self):
        states = np.float32([[0, 0, 0.01, 0], [0, 0, 1, 0], [0, 0, -2, 0]])
        clear = clearness(RULE, states)
        assert np.argsort(clear).tolist() == [0, 1, 2]

    @given(
        trees(n_features=3),
        npst.arrays(np.float32, (5, 3), elements=st.floats(-1e3, 1e3, width=32)),
    )
    def test_it_is_a_weight(self, tree, observed):
        clear = clearness(tree, observed)
        assert np.isfinite(clear).all()
        assert (clear >= 0).all()
        if tree.num_decision_nodes == 0:
            np.testing.assert_array_equal(clear, 1)

    def test_a_sum_times_a_number_is_as_clear(self):
        twice = DecisionTree.weighted_split(
            range(4), 2 * GOAL, 0.0, DecisionTree.leaf(0), DecisionTree.leaf(1)
        )
        np.testing.assert_allclose(clearness(twice, STATES), clearness(RULE, STATES), rtol=1e-5)
