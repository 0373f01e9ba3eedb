"""Dense starts: who goes on in a race, when there is one, and what comes of it."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from fake_backend import FakeBackend
from mirrors_for_tests import MIRRORS, shapes_of
from problems_for_tests import Analytic, config_of, problem_of

from ge_torchrl.environments.backend import Limit
from ge_torchrl.refiners.ties import ties_of
from ge_torchrl.search import heats
from ge_torchrl.search.archive import START
from ge_torchrl.search.population import first_population
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.starts import STARTS, dense_starts, race

KEEPING = {"keep": 3}
# The best action is told by this sum.
GOAL = np.array([0.5, 0.2, 2.0, 1.0])
STATES = np.random.default_rng(0).normal(size=(300, 4)).astype(np.float32)


def value(tree):
    """How often it pushes the cart under the pole."""
    return 100 * float((tree.decide(STATES) == (STATES @ GOAL > 0)).mean())


@pytest.fixture
def sums(monkeypatch):
    """Let every grammar have sums."""
    monkeypatch.setattr(Problem, "is_oblique", True)


def starts(generation=1, limit=None, **changes):
    backend = Analytic(value, luck=1.0)
    config = config_of(archive=KEEPING)
    values = {"races": 2, "count": 4, "max_timesteps": 4000, **changes}
    config = replace(config, starts=replace(config.starts, **values))
    problem = replace(problem_of(backend, config=config), mirror=MIRRORS["cart"])
    population = first_population(problem).population
    backend.limit = limit
    return backend, dense_starts(problem, population, generation)


@pytest.mark.parametrize("mirrored", [True, False])
def test_a_race_finds_a_rule_and_brings_back_those_who_came_far(mirrored):
    rng = np.random.default_rng(0)
    backend = FakeBackend(value, spread=(1.0,) * 4, luck=1.0)
    shapes = shapes_of("cart", rng, mirrored=mirrored)
    trees = race(backend, shapes, shapes.mirror, 6, 60_000, rng)
    assert value(trees[0]) > 90
    assert all(tree.num_decision_nodes == 1 for tree in trees)
    if mirrored:
        assert ties_of(trees[0], MIRRORS["cart"]) is not None
    assert backend.steps.total() < 75_000


def test_the_same_seed_gives_the_same_trees():
    def run(seed):
        rng = np.random.default_rng(seed)
        backend = FakeBackend(value, spread=(1.0,) * 4, luck=1.0)
        return race(backend, shapes_of("cart", np.random.default_rng(9)), MIRRORS["cart"], 3, 5000, rng)

    assert run(1) == run(1)
    assert run(1) != run(2)


@pytest.mark.usefixtures("sums")
def test_a_race_is_run_in_the_first_generations_and_counted():
    backend, contenders = starts()
    assert contenders
    assert all(contender.origin == START for contender in contenders)
    assert 4000 <= backend.steps[STARTS] < 20_000
    for generation in (0, 3):
        assert starts(generation=generation)[1] == []
    assert starts(races=0)[1] == []


def test_where_the_grammar_has_no_sums_there_is_no_race():
    backend, contenders = starts()
    assert contenders == []
    assert backend.steps[STARTS] == 0


@pytest.mark.usefixtures("sums")
def test_a_limit_makes_races_shorter():
    backend, contenders = starts(max_timesteps=30_000, limit=Limit(max_env_steps=20_000))
    assert contenders
    assert backend.steps.total() < 20_000


@pytest.mark.parametrize("most", [3_000, 12_000])
def test_of_a_race_that_a_limit_breaks_off_what_it_has_comes_back(monkeypatch, most):
    # A race that takes no notice of the limit runs into it.
    monkeypatch.setattr(heats._Purse, "left", lambda _: 60_000)
    rng = np.random.default_rng(0)
    backend = FakeBackend(value, spread=(1.0,) * 4, luck=1.0)
    backend.limit = Limit(max_env_steps=most)
    trees = race(backend, shapes_of("cart", rng), MIRRORS["cart"], 6, 60_000, rng)
    assert trees
    assert max(map(value, trees)) > 60


def test_a_race_that_is_slower_than_it_looked_still_comes_to_its_end(monkeypatch):
    rng = np.random.default_rng(0)
    backend = FakeBackend(value, spread=(1.0,) * 4, luck=1.0)
    # A thousand steps a second.
    monkeypatch.setattr(time, "perf_counter", lambda: backend.steps.total() / 1000)
    backend.limit = Limit(deadline=30.0)
    ended = []
    monkeypatch.setattr(heats, "_judged", lambda _, lanes, *__: ended.append(len(lanes)) or lanes)
    assert len(race(backend, shapes_of("cart", rng), MIRRORS["cart"], 6, 10**9, rng)) == 1
    assert ended == [6, 3, 2, 1, 1]
    assert 20_000 < backend.steps.total() < 33_000


@pytest.mark.usefixtures("sums")
def test_a_race_leaves_the_others_their_part_and_the_limit_as_it_was():
    limit = Limit(max_env_steps=40_000)
    backend, contenders = starts(max_timesteps=10**9, limit=limit)
    assert contenders
    assert backend.limit is limit
    assert backend.steps.total() < 30_000
