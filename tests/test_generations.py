"""The loop over generations with refinement: schedule, records, and what a refined tree may do."""

import itertools
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ge_torchrl import applications
from ge_torchrl.config import Config
from ge_torchrl.environments.choose import open_route
from ge_torchrl.experiment import plan
from ge_torchrl.generations import GenerationLoop
from ge_torchrl.records import TrainingRecord
from ge_torchrl.search.champion import REFINEMENT
from ge_torchrl.search.evolution import Evolution
from ge_torchrl.search.exploration import Explored
from ge_torchrl.search.fitness import TrainingEpisodes
from ge_torchrl.search.hall_of_fame import open_hall_of_fame
from ge_torchrl.search.refinement import FAILED, IMPROVED, NOT_IMPROVED
from ge_torchrl.seeding import stream
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.simplify import simplify_exact

BNF = """
<if>        ::= if <condition> then <action> else <action>
<condition> ::= lt(theta, <constant>) | lt(theta_dot, <constant>)
<action>    ::= left | right | <if>
<constant>  ::= [-0.5, 0.5] step 0.01
"""


GOOD = DecisionTree.split(
    2,
    0.0154,
    DecisionTree.split(3, 0.2290, DecisionTree.leaf(0), DecisionTree.leaf(1)),
    DecisionTree.leaf(1),
)


def config(**refiner):
    return Config.from_mapping(
        {
            "env": {
                "id": "CartPole-v1",
                "features": ["x", "x_dot", "theta", "theta_dot"],
                "units": ["", "", "", ""],
                "actions": ["left", "right"],
            },
            "grammar": {"name": "test", "bnf": BNF},
            "ge": {"population_size": 20, "generations": 13, "genotype_length": 40, "gene_probability": 0.1},
            "evaluation": {"episodes": 3, "validation_episodes": 10},
            "refiner": {"name": "test", "schedule": {"every": 4}, **refiner},
        }
    )


class ScriptedRefiner:
    """Refines as the test wrote down: outcome and return after."""

    def __init__(self, script):
        self.script = iter(script)
        self.asked = []

    def refine(self, _route, tree, _config, _seed, name):
        self.asked.append((tree, int(re.search(r"\d+", name)[0])))
        outcome, after, *replaced = next(self.script)
        if outcome == "interrupt":
            raise KeyboardInterrupt
        failure = "broke" if outcome == FAILED else None
        training = TrainingRecord(timesteps=100, updates=2, gradient_steps=8, failure=failure)
        return SimpleNamespace(
            tree=replaced[0] if replaced else tree,
            outcome=outcome,
            return_before=20.0,
            return_after=after,
            thresholds_moved=1,
            largest_threshold_move=0.5,
            leaves_changed=0,
            training=training,
            measuring_seeds=np.arange(4),
            env_steps=150,
            seconds=1.0,
            is_improved=outcome == IMPROVED,
        )


class ScriptedExplorer:
    """Notes what it was asked, marks the generation, and breaks off where the test wrote so."""

    def __init__(self, interrupted_in=()):
        self.interrupted_in = interrupted_in
        self.asked = []

    def note(self, what):
        self.asked.append(what)
        if what in self.interrupted_in:
            raise KeyboardInterrupt

    def explore(self, generation):
        self.note(generation.index)
        return Explored(replace(generation, n_born=-generation.index), refined=2, env_steps=100)

    def finish(self, seeds):
        assert len(seeds) == 3
        self.note("finish")
        return 30


@pytest.fixture
def run(monkeypatch):
    routes = []
    monkeypatch.setattr(applications, "refine", ScriptedRefiner.refine)

    def run(configured, script, hall=False, explorer=None):
        planned = plan(configured)
        routes.append(open_route(planned.spec, threads=1))
        episodes = TrainingEpisodes("fixed", 3, stream(0, "training episodes"))
        evolution = Evolution(configured.ge, planned.tables, routes[-1], episodes, stream(0, "evolution"))
        generations, refinements = [], []
        loop = GenerationLoop(configured, evolution, generations.append)
        if hall:
            loop.hall_of_fame = open_hall_of_fame(configured, routes[-1])
        refiner = ScriptedRefiner(script)
        loop.refine_with(refiner, refinements.append)
        if explorer is not None:
            loop.explore_with(explorer, lambda: explorer.note("before finish"))
        evolved = loop.run()
        return (evolved, loop.hall_of_fame) if hall else (evolved, generations, refinements, refiner)

    yield run
    for route in routes:
        route.close()


def test_refinements_follow_the_schedule_and_never_touch_the_population(run):
    script = [(IMPROVED, 300.0), (NOT_IMPROVED, 10.0), (FAILED, 20.0)]
    evolved, generations, refinements, refiner = run(config(), script)
    assert [record.generation for record in refinements] == [4, 8, 12]
    assert [record.outcome for record in refinements] == [IMPROVED, NOT_IMPROVED, FAILED]
    assert [generation for _, generation in refiner.asked] == [4, 8, 12]
    _, without, _, _ = run(config(schedule={}), [])
    assert [r.best_fitness for r in generations] == [r.best_fitness for r in without]
    assert evolved.env_steps == without[-1].env_steps + 3 * 150
    assert (evolved.refinements, evolved.refine_seconds) == (3, 3.0)


def test_only_an_improved_tree_can_become_the_best(run):
    _, generations, refinements, _ = run(
        config(), [(NOT_IMPROVED, 400.0), (IMPROVED, 450.0), (IMPROVED, 1.0)]
    )
    best = [record.best_refined for record in generations]
    assert best[:8] == [None] * 8
    assert best[8:] == [450.0] * 5
    assert [record.new_best for record in refinements] == [False, True, False]


def test_records_say_which_tree_and_why(run):
    _, generations, refinements, refiner = run(config(), itertools.repeat((IMPROVED, 30.0)))
    for record, (tree, _) in zip(refinements, refiner.asked, strict=True):
        assert record.decision_nodes == tree.n_decision_nodes >= 2
        assert record.chosen in {"best", "random"}
        assert record.fitness_before <= generations[record.generation].best_fitness
        assert (record.timesteps, record.updates, record.gradient_steps) == (100, 2, 8)
        assert record.actor_loss is None, "what was not measured is null, not NaN"


def test_without_a_candidate_the_application_is_skipped_and_said(run):
    # Every fitness counts as the lowest possible.
    nobody = config()
    nobody = Config.from_mapping(
        {**nobody.as_mapping(), "env": {**nobody.as_mapping()["env"], "lowest_fitness_excluded": 500}}
    )
    evolved, _, refinements, refiner = run(nobody, [])
    assert [(record.outcome, record.redraws) for record in refinements] == [("skipped", 20)] * 3
    assert refiner.asked == []
    assert evolved.refinements == 0


def test_ctrl_c_in_a_refinement_keeps_the_generation(run):
    evolved, generations, refinements, _ = run(config(), [(IMPROVED, 300.0), ("interrupt", 0.0)])
    assert evolved.stopped_by == "interrupt"
    assert [record.generation for record in generations] == list(range(9))
    assert len(refinements) == 1
    assert [contender.fitness for contender in evolved.refined] == [300.0]


@pytest.mark.parametrize(("refined", "stopped_by"), [(GOOD, "solved"), (DecisionTree.leaf(0), "generations")])
def test_a_refined_tree_stops_the_run_if_validation_agrees_that_it_solves(run, refined, stopped_by):
    values = config(schedule={"generations": [2]}).as_mapping()
    stopping = Config.from_mapping(
        {
            **values,
            "env": {**values["env"], "solved_at": 499},
            "ge": {**values["ge"], "stop_when_solved": True},
        }
    )
    evolved, generations, *_ = run(stopping, [(IMPROVED, 500.0, refined)])
    assert evolved.stopped_by == stopped_by
    # Ten validation episodes, in which the good tree stands for 500 steps and the other falls after ten.
    assert 80 < evolved.validation_env_steps <= 5000
    assert (evolved.validation_env_steps > 4900) == (stopped_by == "solved")
    assert evolved.env_steps == generations[-1].env_steps, "asking is no part of the search"


def test_the_hall_of_fame_is_offered_the_leaders_and_the_improved_trees_alone(run):
    values = config().as_mapping()
    keeping = Config.from_mapping({**values, "hall_of_fame": {"enabled": True, "episodes": 20}})
    script = [(IMPROVED, 450.0, GOOD), (NOT_IMPROVED, 10.0, DecisionTree.leaf(1)), (FAILED, 20.0)]
    evolved, hall = run(keeping, script, hall=True)
    refined = [member for member in hall.members if member.origin == REFINEMENT]
    assert [(member.tree, member.fitness) for member in refined] == [(GOOD, 450.0)]
    # Of each size of the last generation the fittest was measured.
    for size in np.unique(evolved.last.decision_nodes[np.isfinite(evolved.last.fitness)]):
        assert any(member.tree.n_decision_nodes == size for member in hall.members)


def test_with_write_back_the_population_goes_on_from_the_refined_tree(run):
    script = [(IMPROVED, 500.0, GOOD), (NOT_IMPROVED, 10.0, DecisionTree.leaf(0)), (FAILED, 20.0, GOOD)]
    evolved, generations, refinements, _ = run(config(write_back=True), script)
    _, without, _, _ = run(config(), script)
    best, before = ([record.best_fitness for record in records] for records in (generations, without))
    assert best[:4] == before[:4]
    assert best[4] > before[4]
    assert evolved.last.fitness.max() >= best[4]
    assert [record.written_back for record in refinements] == [True, False, False]
    snapped, lost, failed = (record.return_snapped for record in refinements)
    assert snapped > 50
    assert lost is None, "the grammar derives no lone leaf"
    assert failed is None


def test_several_candidates_are_refined_one_after_another(run):
    evolved, _, refinements, refiner = run(config(candidates=3), itertools.repeat((IMPROVED, 30.0)))
    assert [record.generation for record in refinements] == [4, 4, 4, 8, 8, 8, 12, 12, 12]
    for first in (0, 3, 6):
        individuals = {record.individual for record in refinements[first : first + 3]}
        assert len(individuals) == 3
    assert evolved.refinements == len(refiner.asked) == 9
    assert [record.new_best for record in refinements[4:]] == [False] * 5


def test_ctrl_c_keeps_the_candidates_already_refined(run):
    evolved, _, refinements, _ = run(config(candidates=2), [(IMPROVED, 300.0), ("interrupt", 0.0)])
    assert evolved.stopped_by == "interrupt"
    assert (len(refinements), evolved.refinements) == (1, 1)


def test_by_its_probability_a_chosen_tree_is_refined_or_not(run):
    _, generations, refinements, refiner = run(config(probability=0.0), [])
    assert (refinements, refiner.asked) == ([], [])
    _, without, _, _ = run(config(schedule={}), [])
    assert [record.best_fitness for record in generations] == [record.best_fitness for record in without]
    some = run(config(probability=0.5, candidates=6), itertools.repeat((NOT_IMPROVED, 30.0)))[2]
    assert 0 < len(some) < 18


def test_simplified_or_whole_is_a_setting(run):
    script = itertools.repeat((NOT_IMPROVED, 10.0))
    whole, simple = (
        [tree for tree, _ in run(config(simplify=simplify, candidates=5), script)[3].asked]
        for simplify in (False, True)
    )
    bounds = (
        np.array([-4.8, -np.inf, -0.42, -np.inf], np.float32),
        np.array([4.8, np.inf, 0.42, np.inf], np.float32),
    )
    assert any(simplify_exact(tree, *bounds) != tree for tree in whole)
    assert all(simplify_exact(tree, *bounds) == tree for tree in simple)


@pytest.mark.parametrize(("probability", "chosen"), [(1.0, "best"), (0.0, "random")])
def test_by_its_probability_the_best_tree_is_chosen_or_a_random_one(run, probability, chosen):
    every = config(best_probability=probability, schedule={"every": 1})
    _, generations, refinements, _ = run(every, itertools.repeat((NOT_IMPROVED, 30.0)))
    assert {record.chosen for record in refinements} == {chosen}
    best = [
        record.fitness_before == generations[record.generation].best_fitness
        for record in refinements
        if record.redraws == 0
    ]
    assert len(best) > 5
    assert all(best) == (chosen == "best")


def test_of_each_size_the_structures_that_were_not_refined_yet_come_first(run):
    settings = config(choice="each_size", candidates=4, schedule={"every": 4}, simplify=True)
    _, _, refinements, refiner = run(settings, itertools.repeat((NOT_IMPROVED, 10.0)))
    assert {record.chosen for record in refinements} == {"fittest"}
    first, second = ([tree for tree, generation in refiner.asked if generation == g] for g in (4, 8))
    for trees in (first, second):
        assert len({tree.structure for tree in trees}) == len(trees) == 4
    assert len({tree.n_decision_nodes for tree in first}) > 1
    # Where a structure comes again, those that never came before went before it.
    known = {tree.structure for tree in first}
    again = [tree.structure in known for tree in second]
    assert again == sorted(again)
    assert not again[0]


@pytest.mark.parametrize("choice", ["best_or_random", "each_size"])
def test_trees_of_less_than_so_many_nodes_are_not_refined(run, choice):
    def sizes(min_nodes):
        settings = config(choice=choice, candidates=6, min_nodes=min_nodes)
        refiner = run(settings, itertools.repeat((NOT_IMPROVED, 10.0)))[3]
        return {tree.n_decision_nodes for tree, _ in refiner.asked}

    assert min(sizes(1)) == 1
    assert min(sizes(3)) == 3


def test_exploring_follows_the_schedule_and_ends_with_a_last_refinement(run):
    explorer, script = ScriptedExplorer(), [(NOT_IMPROVED, 10.0)] * 3
    evolved, generations, *_ = run(config(), script, explorer=explorer)
    assert explorer.asked == [4, 8, 12, "before finish", "finish"]
    assert [record.explored for record in generations] == [0] * 4 + [2] * 4 + [4] * 4 + [6]
    assert evolved.explored == 6
    assert evolved.last.n_born == -12, "the generation that exploring gave back is the one that counts"
    _, without, *_ = run(config(), script)
    assert generations[-1].env_steps == without[-1].env_steps + 3 * 100
    assert evolved.env_steps == generations[-1].env_steps + 30
    assert evolved.explore_seconds > 0


def test_the_steps_of_the_hall_of_fame_count_where_the_search_goes_on_from_it(run):
    values, script = config().as_mapping(), [(NOT_IMPROVED, 10.0)] * 3
    keeping = Config.from_mapping({**values, "hall_of_fame": {"enabled": True, "episodes": 20}})
    without, hall = run(keeping, script, hall=True)
    assert (without.hall_env_steps, hall.env_steps > 0) == (0, True)
    explored, hall = run(keeping, script, hall=True, explorer=ScriptedExplorer())
    assert explored.hall_env_steps == hall.env_steps
    assert explored.env_steps == without.env_steps + hall.env_steps + 3 * 100 + 30


def test_ctrl_c_in_exploring_keeps_the_generation_and_leaves_the_last_refinement(run):
    explorer = ScriptedExplorer(interrupted_in=[8])
    evolved, generations, *_ = run(config(), [(NOT_IMPROVED, 10.0)] * 2, explorer=explorer)
    assert (evolved.stopped_by, evolved.last.index, evolved.explored) == ("interrupt", 8, 2)
    assert len(generations) == 9
    assert explorer.asked == [4, 8]


def test_ctrl_c_in_the_last_refinement_loses_nothing_before_it(run):
    explorer = ScriptedExplorer(interrupted_in=["finish"])
    evolved, generations, *_ = run(config(), [(NOT_IMPROVED, 10.0)] * 3, explorer=explorer)
    assert (evolved.stopped_by, evolved.last.index, evolved.explored) == ("generations", 12, 6)
    assert evolved.env_steps == generations[-1].env_steps
