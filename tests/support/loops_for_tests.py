"""The loop over generations, with refinement and exploring as a test wrote them down."""

import re
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np

from ge_torchrl import applications
from ge_torchrl.config import Config
from ge_torchrl.environments.choose import open_route
from ge_torchrl.experiment import plan
from ge_torchrl.generations import GenerationLoop
from ge_torchrl.records import TrainingRecord
from ge_torchrl.search.evolution import Evolution
from ge_torchrl.search.exploration import Explored
from ge_torchrl.search.fitness import TrainingEpisodes
from ge_torchrl.search.hall_of_fame import open_hall_of_fame
from ge_torchrl.search.refinement import FAILED, IMPROVED
from ge_torchrl.seeding import stream
from ge_torchrl.trees.decision_tree import DecisionTree

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


def run_loop(configured, script, hall=False, explorer=None):
    """Run the loop; return where it came, and the hall of fame or what it wrote and the refiner."""
    planned = plan(configured)
    route = open_route(planned.spec, threads=1)
    episodes = TrainingEpisodes("fixed", 3, stream(0, "training episodes"))
    evolution = Evolution(configured.ge, planned.tables, route, episodes, stream(0, "evolution"))
    generations, refinements = [], []
    loop = GenerationLoop(configured, evolution, generations.append)
    if hall:
        loop.hall_of_fame = open_hall_of_fame(configured, route)
    refiner = ScriptedRefiner(script)
    loop.refine_with(refiner, refinements.append)
    if explorer is not None:
        loop.explore_with(explorer, lambda: explorer.note("before finish"))
    try:
        with patch.object(applications, "refine", ScriptedRefiner.refine):
            evolved = loop.run()
    finally:
        route.close()
    return (evolved, loop.hall_of_fame) if hall else (evolved, generations, refinements, refiner)
