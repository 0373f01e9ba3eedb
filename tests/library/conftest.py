"""Small runs, by a call of the library."""

import pytest

import ge_torchrl as ge

SMALL = {
    "ge.generations": 3,
    "ge.population_size": 40,
    "evaluation.validation_episodes": 50,
    "evaluation.test_episodes": 40,
    "evaluation.steps_per_second": 1e8,
    "archive.final_keep": 0,
    "archive.episodes": 50,
}


@pytest.fixture
def small():
    """Settings of a run that takes a moment."""
    return dict(SMALL)


@pytest.fixture(scope="session")
def result():
    """What a small run found."""
    return ge.evolve("CartPole-v1", seed=1, refiner="none", settings=SMALL)
