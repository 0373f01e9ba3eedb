"""The loop over generations with refinement: schedule, records, and what a refined tree may do."""

import itertools

import numpy as np
import pytest
from loops_for_tests import GOOD, ScriptedExplorer, config, run_loop

from ge_torchrl.config import Config
from ge_torchrl.search.champion import REFINEMENT
from ge_torchrl.search.refinement import FAILED, IMPROVED, NOT_IMPROVED
from ge_torchrl.trees.decision_tree import DecisionTree


def test_refinements_follow_the_schedule_and_never_touch_the_population():
    script = [(IMPROVED, 300.0), (NOT_IMPROVED, 10.0), (FAILED, 20.0)]
    evolved, generations, refinements, refiner = run_loop(config(), script)
    assert [record.generation for record in refinements] == [4, 8, 12]
    assert [record.outcome for record in refinements] == [IMPROVED, NOT_IMPROVED, FAILED]
    assert [generation for _, generation in refiner.asked] == [4, 8, 12]
    _, without, _, _ = run_loop(config(schedule={}), [])
    assert [r.best_fitness for r in generations] == [r.best_fitness for r in without]
    assert evolved.env_steps == without[-1].env_steps + 3 * 150
    assert (evolved.refinements, evolved.refine_seconds) == (3, 3.0)


def test_only_an_improved_tree_can_become_the_best():
    _, generations, refinements, _ = run_loop(
        config(), [(NOT_IMPROVED, 400.0), (IMPROVED, 450.0), (IMPROVED, 1.0)]
    )
    best = [record.best_refined for record in generations]
    assert best[:8] == [None] * 8
    assert best[8:] == [450.0] * 5
    assert [record.new_best for record in refinements] == [False, True, False]


def test_records_say_which_tree_and_why():
    _, generations, refinements, refiner = run_loop(config(), itertools.repeat((IMPROVED, 30.0)))
    for record, (tree, _) in zip(refinements, refiner.asked, strict=True):
        assert record.decision_nodes == tree.n_decision_nodes >= 2
        assert record.chosen in {"best", "random"}
        assert record.fitness_before <= generations[record.generation].best_fitness
        assert (record.timesteps, record.updates, record.gradient_steps) == (100, 2, 8)
        assert record.actor_loss is None, "what was not measured is null, not NaN"


def test_without_a_candidate_the_application_is_skipped_and_said():
    # Every fitness counts as the lowest possible.
    nobody = config()
    nobody = Config.from_mapping(
        {**nobody.as_mapping(), "env": {**nobody.as_mapping()["env"], "lowest_fitness_excluded": 500}}
    )
    evolved, _, refinements, refiner = run_loop(nobody, [])
    assert [(record.outcome, record.redraws) for record in refinements] == [("skipped", 20)] * 3
    assert refiner.asked == []
    assert evolved.refinements == 0


def test_ctrl_c_in_a_refinement_keeps_the_generation():
    evolved, generations, refinements, _ = run_loop(config(), [(IMPROVED, 300.0), ("interrupt", 0.0)])
    assert evolved.stopped_by == "interrupt"
    assert [record.generation for record in generations] == list(range(9))
    assert len(refinements) == 1
    assert [contender.fitness for contender in evolved.refined] == [300.0]


@pytest.mark.parametrize(("refined", "stopped_by"), [(GOOD, "solved"), (DecisionTree.leaf(0), "generations")])
def test_a_refined_tree_stops_the_run_if_validation_agrees_that_it_solves(refined, stopped_by):
    values = config(schedule={"generations": [2]}).as_mapping()
    stopping = Config.from_mapping(
        {
            **values,
            "env": {**values["env"], "solved_at": 499},
            "ge": {**values["ge"], "stop_when_solved": True},
        }
    )
    evolved, generations, *_ = run_loop(stopping, [(IMPROVED, 500.0, refined)])
    assert evolved.stopped_by == stopped_by
    # Ten validation episodes, in which the good tree stands for 500 steps and the other falls after ten.
    assert 80 < evolved.validation_env_steps <= 5000
    assert (evolved.validation_env_steps > 4900) == (stopped_by == "solved")
    assert evolved.env_steps == generations[-1].env_steps, "asking is no part of the search"


def test_the_hall_of_fame_is_offered_the_leaders_and_the_improved_trees_alone():
    values = config().as_mapping()
    keeping = Config.from_mapping({**values, "hall_of_fame": {"enabled": True, "episodes": 20}})
    script = [(IMPROVED, 450.0, GOOD), (NOT_IMPROVED, 10.0, DecisionTree.leaf(1)), (FAILED, 20.0)]
    evolved, hall = run_loop(keeping, script, hall=True)
    refined = [member for member in hall.members if member.origin == REFINEMENT]
    assert [(member.tree, member.fitness) for member in refined] == [(GOOD, 450.0)]
    # Of each size of the last generation the fittest was measured.
    for size in np.unique(evolved.last.decision_nodes[np.isfinite(evolved.last.fitness)]):
        assert any(member.tree.n_decision_nodes == size for member in hall.members)


def test_with_write_back_the_population_goes_on_from_the_refined_tree():
    script = [(IMPROVED, 500.0, GOOD), (NOT_IMPROVED, 10.0, DecisionTree.leaf(0)), (FAILED, 20.0, GOOD)]
    evolved, generations, refinements, _ = run_loop(config(write_back=True), script)
    _, without, _, _ = run_loop(config(), script)
    best, before = ([record.best_fitness for record in records] for records in (generations, without))
    assert best[:4] == before[:4]
    assert best[4] > before[4]
    assert evolved.last.fitness.max() >= best[4]
    assert [record.written_back for record in refinements] == [True, False, False]
    snapped, lost, failed = (record.return_snapped for record in refinements)
    assert snapped > 50
    assert lost is None, "the grammar derives no lone leaf"
    assert failed is None


def test_exploring_follows_the_schedule_and_ends_with_a_last_refinement():
    explorer, script = ScriptedExplorer(), [(NOT_IMPROVED, 10.0)] * 3
    evolved, generations, *_ = run_loop(config(), script, explorer=explorer)
    assert explorer.asked == [4, 8, 12, "before finish", "finish"]
    assert [record.explored for record in generations] == [0] * 4 + [2] * 4 + [4] * 4 + [6]
    assert evolved.explored == 6
    assert evolved.last.n_born == -12, "the generation that exploring gave back is the one that counts"
    _, without, *_ = run_loop(config(), script)
    assert generations[-1].env_steps == without[-1].env_steps + 3 * 100
    assert evolved.env_steps == generations[-1].env_steps + 30
    assert evolved.explore_seconds > 0


def test_the_steps_of_the_hall_of_fame_count_where_the_search_goes_on_from_it():
    values, script = config().as_mapping(), [(NOT_IMPROVED, 10.0)] * 3
    keeping = Config.from_mapping({**values, "hall_of_fame": {"enabled": True, "episodes": 20}})
    without, hall = run_loop(keeping, script, hall=True)
    assert (without.hall_env_steps, hall.env_steps > 0) == (0, True)
    explored, hall = run_loop(keeping, script, hall=True, explorer=ScriptedExplorer())
    assert explored.hall_env_steps == hall.env_steps
    assert explored.env_steps == without.env_steps + hall.env_steps + 3 * 100 + 30


def test_ctrl_c_in_exploring_keeps_the_generation_and_leaves_the_last_refinement():
    explorer = ScriptedExplorer(interrupted_in=[8])
    evolved, generations, *_ = run_loop(config(), [(NOT_IMPROVED, 10.0)] * 2, explorer=explorer)
    assert (evolved.stopped_by, evolved.last.index, evolved.explored) == ("interrupt", 8, 2)
    assert len(generations) == 9
    assert explorer.asked == [4, 8]


def test_ctrl_c_in_the_last_refinement_loses_nothing_before_it():
    explorer = ScriptedExplorer(interrupted_in=["finish"])
    evolved, generations, *_ = run_loop(config(), [(NOT_IMPROVED, 10.0)] * 3, explorer=explorer)
    assert (evolved.stopped_by, evolved.last.index, evolved.explored) == ("generations", 12, 6)
    assert evolved.env_steps == generations[-1].env_steps
