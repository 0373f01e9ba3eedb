"""`make bench`: what the speed is, each figure beside its rival in the same run.

Times are the best of a few repetitions, since other work on the machine only ever adds to them. Nothing here is a
test: a slow machine fails no build.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import hydra
from bench_rollouts import ENVIRONMENTS, bench_linearity, bench_rollouts, bench_sums
from rich.console import Console
from rich.table import Table

from ge_torchrl.__main__ import _VERSION_BASE, _config_from, _prepare_hydra
from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.config import Config
from ge_torchrl.config.files import CONF
from ge_torchrl.run.experiment import run

console = Console(width=110)


def composed(*overrides: str) -> Config:
    """The configuration that the command line composes of these overrides."""
    _prepare_hydra()
    with hydra.initialize_config_dir(str(CONF), version_base=_VERSION_BASE):
        return _config_from(hydra.compose("config", overrides=list(overrides)))


def config(environment: str, seed: int = 0) -> Config:
    """The thesis' settings of an environment."""
    return composed(f"experiment=thesis/{environment}", "refiner=none", f"seed={seed}")


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
    table = Table(title="Cost is linear: seconds of evolving 1,000 random trees of CartPole (best of 2)")
    for column in ("25 generations", "50", "100", "200", "8 x / 1 x"):
        table.add_column(column, justify="right")
    thesis = config("cartpole")

    def evolution(generations: int) -> float:
        ge = replace(thesis.ge, generations=generations, population_size=1000)
        return min(timed_run(replace(thesis, ge=ge))[0].evolve_seconds for _ in range(2))

    seconds = [evolution(25 * n) for n in (1, 2, 4, 8)]
    table.add_row(*(f"{s:.4f}" for s in seconds), f"{seconds[-1] / seconds[0]:.1f}")
    console.print(table)


# The program, watched: it ends with the first generation whose best tree returns what the first argument says.
WATCHED = """
import os, sys, time
from ge_torchrl.run.progress import Progress

enough = float(sys.argv[1])

def show(self, record):
    if record.best is not None and record.best >= enough:
        print(time.time(), "torch" in sys.modules, flush=True)
        os._exit(0)

Progress.show = show
from ge_torchrl.__main__ import main

main(sys.argv[2:])
"""


def bench_start() -> None:
    """From process start to the end of the first generation, and to the first useful tree of CartPole."""
    table = Table(
        title="From process start until a tree is shown, kernels cached (best of 3, CartPole: of seeds 0 to 4)"
    )
    for column in ("environment", "shown", "seconds", "median", "torch imported by then"):
        table.add_column(column, justify="right" if column in ("seconds", "median") else "left")
    for environment in ENVIRONMENTS:
        table.add_row(environment, "the first generation's best", *until_shown(environment, -1e9, range(3)))
    table.add_row("cartpole", "a return of 475 or more", *until_shown("cartpole", 475, range(5)))
    console.print(table)


def until_shown(environment: str, enough: float, seeds: range) -> tuple[str, str, str]:
    """Return the least and the median time until a tree that returns enough is shown, and whether torch was there."""
    seconds, torch = [], False
    with tempfile.TemporaryDirectory() as folder:
        for seed in seeds:
            started = time.time()
            arguments = [f"env={environment}", f"seed={seed}", f"hydra.run.dir={folder}/{seed}"]
            told = subprocess.run(
                [sys.executable, "-c", WATCHED, str(enough), *arguments],
                check=True, capture_output=True, text=True, cwd=folder,
            ).stdout.split()  # fmt: skip
            seconds.append(float(told[-2]) - started)
            torch = torch or told[-1] == "True"
    return f"{min(seconds):.2f}", f"{statistics.median(seconds):.2f}", "yes" if torch else "no"


if __name__ == "__main__":
    argparse.ArgumentParser(description="Measure the speed of the program beside its rivals.").parse_args()
    bench_rollouts()
    bench_sums()
    bench_linearity()
    bench_runs()
    bench_scaling()
    bench_start()
