"""Runs that are killed at random instants and go on, many from one process: `python kills_for_tests.py FOLDER NUMBER`.

A process that has loaded everything forks one child for each run, so that a kill costs no start of the program.
"""

import importlib
import io
import os
import random
import resource
import shutil
import signal
import sys
import time
import traceback
from pathlib import Path

import torch
from rich.console import Console
from runs_for_tests import assert_same_bytes, config

from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.run import checkpointing, experiment
from ge_torchrl.run.plan import plan
from ge_torchrl.run.warming import compile_kernels

KERNEL = {}
GYMNASIUM = {"env": {"route": "gymnasium", "workers": 1}}
SHORT = {
    "ge": {"generations": 5, "population_size": 10},
    "evaluation": {"episodes": 2, "validation_episodes": 5, "test_episodes": 5, "threads": 1},
}
ARCHIVE = {
    "archive": {
        "keep": 2, "episodes": 5, "neighbours": 2, "neighbours_drawn": 5, "revisit_factor": 1, "migrants": 2,
        "final_keep": 1, "final_factor": 1,
    }
}  # fmt: skip
ACCEPTS = {
    "schedule": {"every": 2},
    "candidates": 1,
    "acceptance_episodes": 3,
    "measuring_episodes": 3,
    "min_nodes": 1,
}
POLISH = {"polish": {"max_timesteps": 500, "every": 1, "episodes": 2}}
PPO = {
    "ppo": {
        "max_timesteps": 256, "update_timesteps": 128, "snapshot_episodes": 2, "critic_hidden": [4],
        "trees_together": 2,
    }
}  # fmt: skip
REFINERS = {
    "none": {},
    "polish": {**ARCHIVE, **POLISH},
    "cmaes": {"refiner": {"method": "cmaes", **ACCEPTS}, **ARCHIVE, **POLISH},
    "ppo": {"refiner": {"method": "ppo", **ACCEPTS, **PPO}, **ARCHIVE},
    "races": {
        "archive": {"keep": 2, "episodes": 5, "races": 1, "raced": 4},
        "ge": {"max_env_steps": 30_000},
    },
}


def settings_of(refiner, route):
    changes = {name: dict(values) for name, values in SHORT.items()}
    for sections in (REFINERS[refiner], route):
        for name, values in sections.items():
            changes[name] = {**changes.get(name, {}), **values}
    return config(**changes)


def in_child(act, seconds=None):
    """Do something in a child; kill it after some time, if it is not ready before. Return how long it took."""
    started = time.perf_counter()
    child = os.fork()
    if child == 0:
        status = 1
        try:
            act()
            status = 0
        except BaseException:  # noqa: BLE001 (the child ends here)
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(status)
    if seconds is not None:
        while time.perf_counter() - started < seconds:
            time.sleep(0.001)
        os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    if status not in (0, signal.SIGKILL):
        raise AssertionError(f"a child ended with status {status}")
    return time.perf_counter() - started


def begin_or_go_on(settings, folder):
    console = Console(file=io.StringIO())
    if (folder / "config.yaml").exists():
        experiment.resume(folder, console)
    else:
        experiment.run(settings, folder, console)


def killed_and_gone_on(settings, alone, folder, seconds, draws):
    """Kill a run, and the runs that go on from there, at random instants; then let it come to its end."""
    while True:
        checkpointing._TIMES = draws.choice([0, 5, 200])
        in_child(lambda: begin_or_go_on(settings, folder), draws.uniform(0, seconds))
        if draws.random() < 0.7:
            break
    in_child(lambda: begin_or_go_on(settings, folder))
    assert_same_bytes(alone, folder)
    steps = RunFolder(folder).read_history()[-1].generation
    shutil.rmtree(folder)
    return steps


def main(folder, number):
    # Children find loaded what a run loads on its way.
    for module in (
        "refiners.rl.refiner",
        "refiners.rl.collecting",
        "environments.torchrl_env",
        "report.html.writing",
    ):
        importlib.import_module(f"ge_torchrl.{module}")
    torch.set_num_threads(1)
    for refiner in ("cmaes", "ppo"):
        compile_kernels(plan(settings_of(refiner, KERNEL)), "kernel")
    draws, told = random.Random(0), []  # noqa: S311
    cases = [(refiner, route) for refiner in REFINERS for route in (KERNEL, GYMNASIUM)]
    times = {}
    for kill in range(number):
        refiner, route = cases[kill % len(cases)]
        settings, name = settings_of(refiner, route), f"{refiner}-{'gymnasium' if route else 'kernel'}"
        alone, started = folder / name, resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        if not alone.exists():
            times[name] = in_child(lambda: begin_or_go_on(settings, alone))  # noqa: B023
        killed_and_gone_on(settings, alone, folder / f"{name}-killed", times[name], draws)
        told.append(name)
        print(
            f"{name}: {resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - started:.1f} s of processor",
            file=sys.stderr,
            flush=True,
        )
    print(f"{len(told)} kills, {len(set(told))} kinds of runs, all ends alike")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
