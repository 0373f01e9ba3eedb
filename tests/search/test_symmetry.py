"""A mirror that the environment does not have is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirrors_for_tests import MIRRORS, NAMES
from problems_for_tests import cartpole, problem_of

from ge_torchrl.errors import ConfigError
from ge_torchrl.refiners.mirror import Mirror
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.symmetry import MIRROR, check_mirror, standard_errors_apart


def checked(mirror):
    backend = cartpole()
    try:
        check_mirror(replace(problem_of(backend), mirror=mirror))
        return backend.steps[MIRROR]
    finally:
        backend.close()


@pytest.fixture
def sums(monkeypatch):
    monkeypatch.setattr(Problem, "is_oblique", True)


@pytest.mark.usefixtures("sums")
def test_the_mirror_of_cartpole_is_believed():
    assert checked(MIRRORS["cart"]) > 0


@pytest.mark.usefixtures("sums")
@pytest.mark.parametrize(
    "symmetry", [{"actions": {"left": "right"}}, {"negate": ["x", "x_dot", "theta", "theta_dot"]}]
)
def test_half_a_mirror_is_refuted_with_figures(symmetry):
    with pytest.raises(ConfigError, match=r"env.symmetry is refuted: a tree returns .* type '~env.symmetry'"):
        checked(Mirror.declared(symmetry, NAMES["cart"]))


def test_what_nothing_uses_is_not_asked():
    assert checked(Mirror.declared({"actions": {"left": "right"}}, NAMES["cart"])) == 0


def test_equal_returns_are_no_standard_error_apart_and_others_are():
    ones = np.ones(10)
    assert standard_errors_apart(ones, ones) == 0
    assert standard_errors_apart(ones, 2 * ones) > 1000
    assert standard_errors_apart(np.arange(10.0), np.arange(10.0) + 1) == pytest.approx(0.7385, abs=1e-3)
