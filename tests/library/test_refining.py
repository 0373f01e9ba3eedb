import numpy as np
import pytest

import ge_torchrl as ge
from ge_torchrl.library import refining
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


def test_several_are_refined_as_one_batch(monkeypatch):
    batches = []
    refine = refining.refine_proposals

    def watched(problem, proposals, generation):
        batches.append([proposal.tree for proposal in proposals])
        return refine(problem, proposals, generation)

    monkeypatch.setattr(refining, "refine_proposals", watched)
    lying = DecisionTree.leaf(0)
    settings = {**SMALL, "refiner.ppo.max_timesteps": 2_000, "refiner.acceptance_episodes": 50}
    given = [ge.Controller(POOR, NAMES), ge.Controller(lying, NAMES), ge.Controller(POOR, NAMES)]
    refined = ge.refine(iter(given), polish="none", settings=settings)
    assert batches == [[POOR, lying, POOR]]
    assert [one.controller.tree.structure for one in refined] == [one.tree.structure for one in given]
    assert all(one.returns_after.mean() >= one.returns_before.mean() for one in refined)
    assert refined[1].controller == given[1], "a leaf has no numbers to move"
    assert np.array_equal(refined[0].returns_before, refined[2].returns_before)
    assert ge.refine([], polish="none", settings=settings) == []


def test_sums_are_rounded_as_a_run_rounds_them():
    # It leans the right way, too late, and watches the place for nothing.
    leaning = DecisionTree.weighted_split(
        [0, 2, 3],
        [0.00123456, 1.2345678, 0.3456789],
        0.1234567,
        DecisionTree.leaf(0),
        DecisionTree.leaf(1),
    )
    settings = {**SMALL, "polish.max_timesteps": 50_000, "starts.rounding_episodes": 200}
    axis_aligned = ge.Controller(POOR, NAMES)
    rounded, other = ge.refine(
        [ge.Controller(leaning, NAMES), axis_aligned], refiner="cmaes", settings=settings
    )
    assert rounded.improved
    assert "1" in [f"{abs(weight):g}" for weight in rounded.controller.tree.weight]
    assert all(len(f"{number:g}") <= 6 for number in rounded.controller.tree.parameters)
    # Beside it, what has no sums ends on the constants of the grammar, as alone.
    alone = ge.refine(axis_aligned, refiner="cmaes", settings=settings)
    assert other.controller == alone.controller


def test_mistakes_are_told_in_one_line():
    with pytest.raises(ge.UserError, match=r'refiner must be "ppo" or "cmaes", .* got \'none\''):
        ge.refine(ge.Controller(POOR, NAMES), refiner="none", settings=SMALL)
    with pytest.raises(ge.UserError, match="controller must be a controller"):
        ge.refine("tree.json")
    with pytest.raises(ge.UserError, match="or a list of them; got"):
        ge.refine(["tree.json"])
    with pytest.raises(ge.UserError, match="or a list of them; got"):
        ge.refine({1: ge.Controller(POOR, NAMES)})
