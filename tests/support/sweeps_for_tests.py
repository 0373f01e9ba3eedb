"""Folders of finished runs with plausible content, written in a moment."""

from __future__ import annotations

from dataclasses import replace

from records_for_tests import summary

from ge_torchrl.artefacts import RunFolder
from ge_torchrl.config import Config
from ge_torchrl.records import GenerationRecord, HallOfFameRecord, RefinementRecord
from ge_torchrl.refiner_section import RefinerConfig, ScheduleConfig
from ge_torchrl.sections import EnvironmentConfig, EvaluationConfig, GEConfig, GrammarConfig
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.labels import TreeLabels
from ge_torchrl.trees.serialization import TreeDocument

leaf, split = DecisionTree.leaf, DecisionTree.split
CARTPOLE = TreeLabels(
    "CartPole-v1", ("x", "x_dot", "theta", "theta_dot"), ("m", "m/s", "rad", "rad/s"), ("left", "right")
)
PRUNED = split(2, 0.0154, split(3, 0.229, leaf(0), leaf(1)), leaf(1))
FULL = split(0, 4.8, PRUNED, leaf(0))


def refiner_config(name, *, every=40, **changes):
    """Settings of refinement by a method, or of none at all."""
    if name == "none":
        return RefinerConfig()
    return RefinerConfig(name=name, method=name, schedule=ScheduleConfig(every=every), **changes)


def config(*, seed=0, refiner="none", environment="CartPole-v1", generations=200, **changes):
    return Config(
        env=EnvironmentConfig(id=environment, solved_at=475.0),
        grammar=GrammarConfig(name="cartpole", bnf="<dt> ::= leaf"),
        ge=GEConfig(population_size=20, generations=generations, genotype_length=100, gene_probability=0.1),
        evaluation=EvaluationConfig(episodes=5),
        refiner=refiner_config(refiner),
        seed=seed,
        **changes,
    )


def generation(number, best, refined=None, steps=1000):
    return GenerationRecord(
        generation=number,
        best_fitness=best,
        best_refined=refined,
        median_fitness=9.4,
        mean_fitness=20.0,
        best_decision_nodes=2,
        born=20,
        invalid=1,
        env_steps=steps * (number + 1),
        elapsed_seconds=0.5 * (number + 1),
        evaluation_seconds=0.4,
        variation_seconds=0.1,
    )


def history(best, refined=(), steps=1000):
    """Records of these best fitnesses; `refined` holds the first values of `best_refined`, then its last one.

    A generation takes `steps` environment steps.
    """
    refined = [*refined, *[refined[-1] if refined else None] * (len(best) - len(refined))]
    return [
        generation(number, *values, steps) for number, values in enumerate(zip(best, refined, strict=True))
    ]


def refinement(number=40, *, before=100.0, again=90.0, after=480.0, **changes):
    """A refinement; `before` on the training episodes, `again` and `after` on the unseen ones."""
    values = {
        "generation": number,
        "outcome": "improved" if after > again else "not_improved",
        "chosen": "random",
        "redraws": 1,
        "individual": 7,
        "decision_nodes": 3,
        "fitness_before": before,
        "return_before": again,
        "soft_return": 200.0,
        "return_after": after,
        "new_best": after > before,
        "thresholds_moved": 1,
        "largest_threshold_move": 0.02,
        "leaves_changed": 2,
        "timesteps": 100_000,
        "updates": 33,
        "gradient_steps": 1980,
        "actor_loss": -0.01,
        "critic_loss": 3.0,
        "clip_fraction": 0.1,
        "kl": 0.01,
        "failure": None,
        "refine_seconds": 1.0,
    }
    return RefinementRecord(**{**values, **changes})


def skipped(number=40):
    nothing = dict.fromkeys(
        name
        for name in RefinementRecord.__dataclass_fields__
        if name not in ("generation", "outcome", "redraws", "new_best", "refine_seconds")
    )
    return refinement(number, outcome="skipped", redraws=20, new_best=False, **nothing)


def honoured(decision_nodes, test_mean, *, validation_mean=None, **changes):
    """The best tree of one size."""
    values = {
        "decision_nodes": decision_nodes,
        "depth": decision_nodes,
        "complexity_M": 17.8 * decision_nodes,
        "archive_mean": test_mean,
        "validation_mean": test_mean if validation_mean is None else validation_mean,
        "test_mean": test_mean,
        "test_std": 1.5,
        "origin": "population",
    }
    return HallOfFameRecord(**{**values, **changes})


def chain(decision_nodes):
    """A tree of this size, one decision below the other."""
    tree = leaf(0)
    for number in range(decision_nodes):
        tree = split(3, 0.1 * number, tree, leaf(1))
    return tree


def write_run(path, *, seed=0, refiner="none", generations=None, refinements=(), hall_of_fame=(), **changes):
    """Write a finished run; `changes` are of its summary."""
    generations = history([100.0, 500.0]) if generations is None else generations
    found = summary(seed=seed, generations=len(generations), **changes)
    settings = config(
        seed=seed, refiner=refiner, environment=found.environment, generations=max(1, len(generations))
    )
    folder = RunFolder.create(path, settings)
    with folder.history_writer() as writer:
        for record in generations:
            writer.write(record)
    if refiner != "none":
        with folder.refinements_writer() as writer:
            for record in refinements:
                writer.write(record)
    labels = replace(CARTPOLE, environment=found.environment)
    folder.write_trees(TreeDocument(PRUNED, labels), TreeDocument(FULL, labels), "a tree\n")
    if hall_of_fame:
        folder.write_hall_of_fame(
            [(record, TreeDocument(chain(record.decision_nodes), labels)) for record in hall_of_fame]
        )
    folder.write_summary(found)
    return path
