"""`make bench`: what the speed is, each figure beside its rival in the same run.

Times are the best of a few repetitions, since other work on the machine only ever adds to them. Nothing here is a
test: a slow machine fails no build.
"""

import itertools
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import hydra
import numpy as np
from rich.console import Console
from rich.table import Table

from ge_torchrl.__main__ import _CONF, _VERSION_BASE, _config_from, _prepare_hydra
from ge_torchrl.artefacts import RunFolder
from ge_torchrl.config import Config
from ge_torchrl.environments.choose import open_route
from ge_torchrl.experiment import plan, run
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.ge.operators import random_population
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.simplify import simplify_forest

ENVIRONMENTS = ("cartpole", "mountaincar", "acrobot")
TREES, EPISODES = 200, 128
console = Console(width=110)


def composed(*overrides: str) -> Config:
    """The configuration that the command line composes of these overrides."""
    _prepare_hydra()
    with hydra.initialize_config_dir(str(_CONF), version_base=_VERSION_BASE):
        return _config_from(hydra.compose("config", overrides=list(overrides)))


def config(environment: str, seed: int = 0) -> Config:
    """The thesis' settings of an environment."""
    return composed(f"experiment=thesis/{environment}", "refiner=none", f"seed={seed}")


def distinct_trees(environment: str, n: int):
    """Trees of a half-evolved population, all different after simplification, as fitness meets them."""
    planned = plan(config(environment))
    low, high = planned.spec.low, planned.spec.high
    rng = np.random.default_rng(0)
    trees = {}
    while len(trees) < n:
        codons = random_population(500, planned.config.ge.genotype_length, rng)
        forest = simplify_forest(map_population(codons, planned.tables).forest, low, high)
        for index in np.flatnonzero(forest.sizes > 1):
            trees.setdefault(forest.tree(index))
    return planned.spec, list(itertools.islice(trees, n))


def gymnasium_loop(spec, trees, seconds: float) -> float:
    """Steps per second of the loop that everybody writes: one environment, one tree, plain Python."""
    environment = gym.make(spec.id)
    nested = [as_nested(tree) for tree in trees]
    steps, started = 0, time.perf_counter()
    for seed, tree in zip(itertools.count(), itertools.cycle(nested), strict=False):
        observation, _ = environment.reset(seed=seed)
        ended = False
        while not ended:
            node = tree
            while isinstance(node, tuple):
                feature, threshold, left, right = node
                node = left if observation[feature] < threshold else right
            observation, _, terminated, truncated, _ = environment.step(node)
            ended = terminated or truncated
            steps += 1
        if time.perf_counter() - started > seconds:
            return steps / (time.perf_counter() - started)
    raise AssertionError


def as_nested(tree, node=0):
    """The tree as nested tuples, the quickest form for plain Python."""
    if tree.children_left[node] == tree.NO_CHILD:
        return int(tree.action[node])
    children = tree.children_left[node], tree.children_right[node]
    return (
        int(tree.feature[node]),
        tree.threshold[node],
        *(as_nested(tree, int(child)) for child in children),
    )


def best_of(n: int, function) -> float:
    """Seconds of the fastest of `n` calls."""
    times = []
    for _ in range(n):
        started = time.perf_counter()
        function()
        times.append(time.perf_counter() - started)
    return min(times)


def bench_rollouts() -> None:
    table = Table(
        title=f"Evaluating {TREES} different trees on {os.cpu_count()} cores: million environment steps a second"
    )
    for column in (
        "environment",
        "Gymnasium loop",
        "5 episodes a tree",
        "ratio",
        f"{EPISODES} episodes a tree",
        "ratio",
    ):
        table.add_column(column, justify="left" if column == "environment" else "right")
    for environment in ENVIRONMENTS:
        spec, trees = distinct_trees(environment, TREES)
        rival = gymnasium_loop(spec, trees, seconds=3)
        cells = [spec.id, f"{rival / 1e6:.3f}"]
        route = open_route(spec, "compiled")
        for n_episodes in (5, EPISODES):
            forest, seeds = Forest.stack(trees), np.arange(n_episodes)
            steps = route.evaluate(forest, seeds).env_steps
            rate = steps / best_of(7, lambda f=forest, s=seeds, r=route: r.evaluate(f, s))
            cells += [f"{rate / 1e6:.0f}", f"{rate / rival:.0f} x"]
        route.close()
        table.add_row(*cells)
    console.print(table)


def bench_runs() -> None:
    table = Table(title="A GE run at the thesis' settings, kernels cached (best of 3)")
    for column in (
        "environment",
        "evolution s",
        "goal s",
        "evaluation s",
        "variation + mapping s",
        "share of wall",
        "share of CPU",
    ):
        table.add_column(column, justify="left" if column == "environment" else "right")
    goals = {"cartpole": 1, "acrobot": 3, "mountaincar": 12}
    for environment in ENVIRONMENTS:
        summary, evaluation, variation = min(
            (timed_run(config(environment)) for _ in range(3)), key=lambda timed: timed[0].evolve_seconds
        )
        threads = os.cpu_count() or 1
        table.add_row(
            summary.environment,
            f"{summary.evolve_seconds:.2f}",
            str(goals[environment]),
            f"{evaluation:.2f}",
            f"{variation:.2f}",
            f"{variation / evaluation:.0%}",
            f"{variation / (evaluation * threads):.0%}",
        )
    console.print(table)


def timed_run(configured: Config):
    """Run, and add up where the time of evolution went."""
    with tempfile.TemporaryDirectory() as folder:
        summary = run(configured, Path(folder) / "run", Console(quiet=True))
        history = RunFolder(Path(folder) / "run").read_history()
    return summary, sum(r.evaluation_seconds for r in history), sum(r.variation_seconds for r in history)


def bench_scaling() -> None:
    table = Table(title="Cost is linear: seconds of evaluating random trees of CartPole (best of 7)")
    for column in ("doubled", "1 x", "2 x", "4 x", "8 x", "8 x / 1 x"):
        table.add_column(column, justify="left" if column == "doubled" else "right")
    planned = plan(config("cartpole"))
    route = open_route(planned.spec, "compiled")

    def evaluation(population: int, episodes: int) -> float:
        codons = random_population(population, 100, np.random.default_rng(1))
        forest, seeds = map_population(codons, planned.tables).forest, np.arange(episodes)
        return best_of(7, lambda: route.evaluate(forest, seeds))

    def evolution(generations: int) -> float:
        ge = replace(planned.config.ge, generations=generations, population_size=1000)
        return min(timed_run(replace(planned.config, ge=ge))[0].evolve_seconds for _ in range(2))

    rows = {
        "population (1,000 trees, 8 episodes)": [evaluation(1000 * n, 8) for n in (1, 2, 4, 8)],
        "episodes (1,000 trees, 64 episodes)": [evaluation(1000, 64 * n) for n in (1, 2, 4, 8)],
        "generations (1,000 trees, 25 generations)": [evolution(25 * n) for n in (1, 2, 4, 8)],
    }
    route.close()
    for name, seconds in rows.items():
        table.add_row(name, *(f"{s:.4f}" for s in seconds), f"{seconds[-1] / seconds[0]:.1f}")
    console.print(table)


def bench_start() -> None:
    """From process start to the first generation, and whether a GE-only run imports torch."""
    program = (
        "import sys, time, os\n"
        "from ge_torchrl import experiment\n"
        "show = experiment.Progress.show\n"
        "def first(self, record):\n"
        "    print(time.time(), 'torch' in sys.modules, flush=True)\n"
        "    os._exit(0)\n"
        "experiment.Progress.show = first\n"
        "from ge_torchrl.__main__ import main\n"
        "main(sys.argv[1:])\n"
    )
    table = Table(title="From process start to the end of the first generation, kernels cached (best of 5)")
    for column in ("environment", "seconds", "goal s", "torch imported"):
        table.add_column(column, justify="left" if column == "environment" else "right")
    with tempfile.TemporaryDirectory() as folder:
        for environment in ENVIRONMENTS:
            seconds, torch = [], False
            for attempt in range(5):
                started = time.time()
                arguments = [f"env={environment}", f"hydra.run.dir={folder}/{environment}{attempt}"]
                output = subprocess.run(
                    [sys.executable, "-c", program, *arguments],
                    check=True,
                    capture_output=True,
                    text=True,
                    cwd=folder,
                ).stdout.split()
                seconds.append(float(output[-2]) - started)
                torch = output[-1] == "True"
            table.add_row(environment, f"{min(seconds):.2f}", "2.5", "yes" if torch else "no")
    console.print(table)


if __name__ == "__main__":
    bench_rollouts()
    bench_runs()
    bench_scaling()
    bench_start()
