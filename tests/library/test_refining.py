import pytest

import ge_torchrl as ge
from ge_torchrl.trees.controller import Names
from ge_torchrl.trees.tree import DecisionTree

# It leans the right way, from far too large an angle on.
POOR = DecisionTree.axis_aligned([2], [0.15], [-1], [-2], [0, 1])
NAMES = Names(
    "CartPole-v1", ("x", "x_dot", "theta", "theta_dot"), ("m", "m/s", "rad", "rad/s"), ("left", "right")
)
SMALL = {
    "evaluation.validation_episodes": 200,
    "evaluation.test_episodes": 100,
    "evaluation.steps_per_second": 1e8,
}


def test_numbers_move_to_where_they_return_more():
    refined = ge.refine(
        ge.Controller(POOR, NAMES), refiner="cmaes", settings={**SMALL, "polish.max_timesteps": 50_000}
    )
    assert refined.improved
    assert refined.returns_after.mean() > refined.returns_before.mean() + 5
    assert refined.controller.tree.structure == POOR.structure
    assert refined.controller.provenance["refined_by"] == "cmaes"
    assert repr(refined).startswith("improved, ")
    again = ge.refine(
        ge.Controller(POOR, NAMES), refiner="cmaes", settings={**SMALL, "polish.max_timesteps": 50_000}
    )
    assert again.controller == refined.controller, "one seed, one answer"


def test_names_of_ones_own_are_kept():
    own = Names("CartPole-v1", ("a", "b", "c", "d"), ("",) * 4, ("l", "r"))
    refined = ge.refine(
        ge.Controller(POOR, own), refiner="cmaes", settings={**SMALL, "polish.max_timesteps": 2_000}
    )
    assert refined.controller.names == own


def test_ppo_refines_it_too():
    settings = {**SMALL, "refiner.ppo.max_timesteps": 2_000, "refiner.acceptance_episodes": 50}
    refined = ge.refine(ge.Controller(POOR, NAMES), polish="none", settings=settings)
    assert refined.returns_after.mean() >= refined.returns_before.mean()
    if not refined.improved:
        assert refined.controller == ge.Controller(POOR, NAMES)
        assert "not improved" in repr(refined)


def test_mistakes_are_told_in_one_line():
    with pytest.raises(ge.UserError, match=r'refiner must be "ppo" or "cmaes", .* got \'none\''):
        ge.refine(ge.Controller(POOR, NAMES), refiner="none", settings=SMALL)
    with pytest.raises(ge.UserError, match="controller must be a controller"):
        ge.refine("tree.json")
