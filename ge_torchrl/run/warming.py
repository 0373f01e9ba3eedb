"""Kernels are compiled before a run's clock starts, so that the limits of a first run are its own."""

from __future__ import annotations

from contextlib import closing
from typing import Any

import numpy as np

from ge_torchrl.compilation import is_compiled_before, note_compiled
from ge_torchrl.config import Config
from ge_torchrl.environments.backend import SoftForest
from ge_torchrl.environments.kernel_backend import KernelBackend
from ge_torchrl.environments.kernel_choice import has_kernel
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.ge.operators import random_population
from ge_torchrl.refiners.local_search import LocalSearch
from ge_torchrl.run.plan import Plan
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.step import first_state, step
from ge_torchrl.seeding import stream
from ge_torchrl.trees.simplify import simplify

# As few of everything as a generation with all its parts takes.
_TINY: dict[str, dict[str, Any]] = {
    "ge": {
        "population_size": 20, "generations": 3, "restarts": 0, "tournament_size": 2, "stop_when_solved": False,
        "max_seconds": None, "max_env_steps": 0,
    },
    "evaluation": {"episodes": 1, "validation_episodes": 1, "test_episodes": 1},
    "refiner": {"method": "none"},
    "polish": {"every": 1, "max_timesteps": 1, "episodes": 1},
    "archive": {"keep": 1, "episodes": 1, "neighbours": 1, "neighbours_drawn": 2, "revisit_factor": 0},
}  # fmt: skip


def is_first_of_its_kind(planned: Plan) -> bool:
    """Tell whether no run of this kind was on this machine before, so that this one has to compile its kernels."""
    return not is_compiled_before(_kind(planned))


def _kind(planned: Plan) -> str:
    # Leaves of values, sums and soft trees have kernels of their own, or other types for the same ones.
    config, grammar = planned.config, planned.tables.grammar
    route = "kernel" if config.env.route != "gymnasium" and has_kernel(planned.spec) else "gymnasium"
    return f"{route}-{grammar.splits}-{grammar.leaves}-{config.refiner.method}"


def compile_kernels(planned: Plan, route: str) -> None:
    """Call every kernel that a run may call: two tiny generations, of which nothing is kept.

    Args:
        planned: What the run is to do.
        route: How its environment is stepped: "kernel" or "gymnasium", where only codons and trees have kernels.
    """
    config = _tiny(planned.config)
    if route != "kernel":
        codons = random_population(2, config.ge.genotype_length, stream(0, "warming"))
        simplify(map_population(codons, planned.tables, config.ge.wraps), planned.spec.low, planned.spec.high)
        note_compiled(_kind(planned))
        return
    with closing(KernelBackend(planned.spec, 1)) as backend:
        problem = Problem(
            config, planned.tables, backend, None, LocalSearch(backend, config.polish, "polish")
        )
        state, _ = first_state(problem)
        step(problem, state)
        if planned.config.refiner.method == "ppo":
            backend.sampler([stream(0, "warming")]).sample(_softest(planned.spec), 1, "warming")
    note_compiled(_kind(planned))


def _tiny(config: Config) -> Config:
    values = config.resolved(1e8).as_mapping()
    return Config.from_mapping({**values, **{name: {**values[name], **few} for name, few in _TINY.items()}})


def _softest(spec: EnvironmentSpec) -> SoftForest:
    """Return a lone leaf that takes any action, or one around 0, beside a row of padding."""
    n = spec.n_actions
    soft = SoftForest.with_actions(
        feature=np.zeros((1, 1), np.int32),
        threshold=np.zeros((1, 1), np.float32),
        alpha=np.ones((1, 1)),
        children_left=np.full((1, 1), ~0, np.int32),
        children_right=np.full((1, 1), ~0, np.int32),
        probabilities=np.full((1, 1, n), 1 / n),
    )
    if not spec.is_continuous:
        return soft
    return soft._replace(
        probabilities=np.zeros((1, 1, 0)),
        mean=np.zeros((1, 1, n)),
        leaf_weight=np.zeros((1, 1, spec.n_features, n)),
        sd=np.ones((1, 1, n)),
    )
