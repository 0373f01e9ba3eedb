"""`make bench`: what the speed is, each figure beside its rival in the same run.

Times are the best of a few repetitions, since other work on the machine only ever adds to them. Nothing here is a
test: a slow machine fails no build.
"""

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import hydra
from bench_rollouts import ENVIRONMENTS, bench_linearity, bench_rollouts
from rich.console import Console
from rich.table import Table

from ge_torchrl.__main__ import _CONF, _VERSION_BASE, _config_from, _prepare_hydra
from ge_torchrl.artefacts import RunFolder
from ge_torchrl.config import Config
from ge_torchrl.experiment import plan, run

console = Console(width=110)


def composed(*overrides: str) -> Config:
    """The configuration that the command line composes of these overrides."""
    _prepare_hydra()
    with hydra.initialize_config_dir(str(_CONF), version_base=_VERSION_BASE):
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
    planned = plan(config("cartpole"))

    def evolution(generations: int) -> float:
        ge = replace(planned.config.ge, generations=generations, population_size=1000)
        return min(timed_run(replace(planned.config, ge=ge))[0].evolve_seconds for _ in range(2))

    seconds = [evolution(25 * n) for n in (1, 2, 4, 8)]
    table.add_row(*(f"{s:.4f}" for s in seconds), f"{seconds[-1] / seconds[0]:.1f}")
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
    bench_linearity()
    bench_runs()
    bench_scaling()
    bench_start()
