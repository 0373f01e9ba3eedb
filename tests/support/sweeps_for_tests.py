"""Folders of finished runs with plausible content, written in a moment."""

from __future__ import annotations

from dataclasses import replace

from records_for_tests import history, summary

from ge_torchrl.artefacts.folder import SUMMARY, RunFolder
from ge_torchrl.artefacts.lines import summary_text
from ge_torchrl.artefacts.texts import write_text
from ge_torchrl.config import (
    ArchiveConfig,
    Config,
    EnvironmentConfig,
    EvaluationConfig,
    GEConfig,
    GrammarConfig,
    PolishConfig,
    RefinerConfig,
    ScheduleConfig,
)
from ge_torchrl.trees.controller import Controller, Names
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
CARTPOLE = Names(
    id="CartPole-v1",
    features=("x", "x_dot", "theta", "theta_dot"),
    units=("m", "m/s", "rad", "rad/s"),
    actions=("left", "right"),
)
PRUNED = split(2, 0.0154, split(3, 0.229, leaf(0), leaf(1)), leaf(1))
FULL = split(0, 4.8, PRUNED, leaf(0))
NO_ARCHIVE = ArchiveConfig(keep=0, neighbours=0, revisit_factor=0, migrants=0, final_keep=0)
KEEPING = replace(NO_ARCHIVE, keep=8)

# What a method needs of a configuration.
METHODS = {
    "GE": {"refiner": "none"},
    "GE+PPO": {"refiner": "ppo"},
    "GE+PPO+polish": {"refiner": "ppo", "polish": 1},
    "GE+CMA-ES": {"refiner": "cmaes"},
    "GE+polish": {"refiner": "none", "polish": 1},
    "thesis": {"refiner": "ppo", "parsimony": "none", "archive": NO_ARCHIVE},
}


def controller(tree, names=CARTPOLE):
    return Controller(tree, names)


def config(
    method="GE", *, seed=0, environment="CartPole-v1", generations=200, every=40, candidates=1, **changes
):
    """The configuration of a run on kernels; `changes` are of `ge`, and `archive` is the whole section."""
    settings = {**METHODS[method], **changes}
    refiner, polish = settings.pop("refiner"), settings.pop("polish", 0)
    left_open = Config(
        env=EnvironmentConfig(id=environment, solved_at=475.0),
        grammar=GrammarConfig(name="cartpole", bnf="<dt> ::= leaf"),
        archive=settings.pop("archive", KEEPING),
        ge=GEConfig(population_size=20, generations=generations, genotype_length=100, **settings),
        evaluation=EvaluationConfig(episodes=5),
        refiner=RefinerConfig(method=refiner, schedule=ScheduleConfig(every=every), candidates=candidates),
        polish=PolishConfig(every=polish),
        seed=seed,
    )
    return left_open.resolved(steps_per_second=1e8)


def chain(decision_nodes):
    """A tree of this size, one decision below the other."""
    tree = leaf(0)
    for number in range(decision_nodes):
        tree = split(3, 0.1 * number, tree, leaf(1))
    return tree


def write_run(
    path, method="GE", *, seed=0, generations=None, refinements=(), archive=(), settings=None, **changes
):
    """Write a finished run; `settings` are of `config`, `changes` of its summary."""
    generations = history([100.0, 500.0]) if generations is None else generations
    does = METHODS[method]
    done = {"refined": int(does["refiner"] != "none"), "polished": does.get("polish", 0)}
    found = summary(seed=seed, generations=len(generations), **{**done, **changes})
    planned = {"environment": found.environment, "generations": max(1, len(generations)), **(settings or {})}
    made = config(method, seed=seed, **planned)
    folder = RunFolder.create(path, made)
    with folder.history_writer() as writer:
        for record in generations:
            writer.write(record)
    if made.refiner.enabled:
        with folder.refinements_writer() as writer:
            for record in refinements:
                writer.write(record)
    names = replace(CARTPOLE, id=found.environment)
    folder.write_trees(controller(PRUNED, names), controller(FULL, names), "a tree\n")
    if archive:
        folder.write_archive(
            [(record, controller(chain(record.decision_nodes), names)) for record in archive]
        )
    # As an earlier version wrote it, which listed no other files: tests change them.
    write_text(path / SUMMARY, summary_text(found, {}))
    folder.release()
    return path
