import pytest
from sweeps_for_tests import KEEPING, METHODS, config

from ge_torchrl.report import methods
from ge_torchrl.report.methods import added_by, done_by, method_of, refiner_of


@pytest.mark.parametrize(
    ("method", "refiner", "added"),
    [
        ("GE", "", ""),
        ("GE+PPO", "PPO", "PPO"),
        ("GE+PPO+polish", "PPO", "PPO and polish"),
        ("GE+CMA-ES", "CMA-ES", "CMA-ES"),
        ("GE+polish", "", "polish"),
        ("thesis", "PPO", "PPO"),
    ],
)
def test_methods_are_named_after_what_they_add(method, refiner, added):
    assert method_of(config(method)) == method
    assert (refiner_of(method), added_by(method)) == (refiner, added)


def test_all_methods_have_their_place_in_reports():
    assert sorted(methods.METHODS) == sorted(METHODS)


def test_a_polish_beside_cmaes_is_nothing_of_its_own():
    assert method_of(config("GE+CMA-ES", polish=1)) == "GE+CMA-ES"


@pytest.mark.parametrize("changes", [{"parsimony": "lexicographic"}, {"archive": KEEPING}, {"polish": 1}])
def test_what_adds_to_the_thesis_is_not_the_thesis(changes):
    assert method_of(config("thesis", **changes)) != "thesis"


def test_ge_with_the_settings_of_the_thesis_is_ge_alone():
    assert method_of(config("thesis", refiner="none")) == "GE"


@pytest.mark.parametrize(
    ("method", "refined", "polished", "told"),
    [
        ("GE+PPO+polish", 5, 9, "GE+PPO+polish"),
        ("GE+PPO+polish", 0, 9, "GE+polish; PPO refined no tree"),
        ("GE+PPO+polish", 5, 0, "GE+PPO; no tree was polished"),
        ("GE+PPO+polish", 0, 0, "GE; PPO refined no tree; no tree was polished"),
        ("GE+CMA-ES", 0, 0, "GE; CMA-ES refined no tree"),
        ("thesis", 0, 0, "GE; PPO refined no tree"),
        ("thesis", 3, 0, "thesis"),
        ("GE", 0, 0, "GE"),
    ],
)
def test_what_was_done_is_told_and_not_what_was_set(method, refined, polished, told):
    assert done_by(method, refined, polished) == told
