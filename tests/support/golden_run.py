"""The golden run: five generations and a verdict as JSON, which no refactoring may change.

What changes results on purpose rewrites it, from the top of the repository: `python tests/support/golden_run.py`
"""

import json
from pathlib import Path
from unittest.mock import patch

from problems_for_tests import Nudge, cartpole, problem_of

from ge_torchrl.artefacts.records import CLOCK_FIELDS
from ge_torchrl.run.recording import generation_record, refinement_records
from ge_torchrl.search import refinement
from ge_torchrl.search.conclusion import choose, contenders_of, examine, refine_once_more
from ge_torchrl.search.step import first_state, step

PATH = Path(__file__).parent.parent / "golden" / "run.json"
GENERATIONS = 5


# So few episodes show no gain of three standard errors.
@patch.object(refinement, "CLEARLY", 1.0)
def golden_run():
    """Return what a small run on CartPole's kernel finds; no torch and no CMA-ES is in it."""
    backend = cartpole()
    problem = problem_of(
        backend,
        Nudge(backend),
        Nudge(backend, "polish"),
        ge={"generations": GENERATIONS},
        evaluation={"episodes": 5},
        refiner={
            "schedule": {"every": 2},
            "candidates": 2,
            "acceptance_episodes": 20,
        },
        polish={"every": 1, "settling_episodes": 5},
        archive={
            "keep": 2,
            "neighbours": 4,
            "revisit_factor": 2,
            "migrants": 4,
            "final_keep": 1,
        },
    )
    generations, refinements = [], []
    state, events = first_state(problem)
    while True:
        generations.append(_told(generation_record(state, events, backend.steps.total(), 0.0)))
        refinements += [_told(record) for record in refinement_records(state, events)]
        if state.generation + 1 == GENERATIONS:
            break
        state, events = step(problem, state)
    members = [_member(one) for one in state.archive.members]
    state = refine_once_more(problem, state)
    verdict = examine(problem, *choose(problem, contenders_of(problem, state)))
    steps = dict(sorted(backend.steps.items()))
    backend.close()
    return {
        "generations": generations,
        "refinements": refinements,
        "archive": members,
        "champion": {
            **_tree(verdict.champion.pruned),
            "origin": verdict.champion.origin,
            "train_fitness": verdict.champion.train_fitness,
            "validation_mean": float(verdict.champion.validation_returns.mean()),
            "test_mean": float(verdict.test_returns.mean()),
        },
        "archive_test_means": verdict.test_returns_by_size.mean(axis=1).tolist(),
        "steps": steps,
    }


def _told(record):
    return {name: value for name, value in vars(record).items() if name not in CLOCK_FIELDS}


def _member(member):
    fitness = {"archive_fitness": member.archive_fitness, "train_fitness": member.train_fitness}
    return {**_tree(member.tree), "origin": member.origin, **fitness}


def _tree(tree):
    return {
        "feature": tree.feature.tolist(),
        "children_left": tree.children_left.tolist(),
        "children_right": tree.children_right.tolist(),
        "action": tree.action.tolist(),
        "parameters": tree.parameters.tolist(),
    }


def as_text(golden):
    """Return the text of the file."""
    return json.dumps(golden, indent=1) + "\n"


if __name__ == "__main__":
    PATH.write_text(as_text(golden_run()), encoding="utf-8")
