"""What a first run compiles before its clock starts."""

import os
import subprocess
import sys

import pytest
from problems_for_tests import config_of

from ge_torchrl.run.plan import plan
from ge_torchrl.run.warming import compile_kernels, is_first_of_its_kind

# A process of its own: in this one other tests have called kernels.
SCRIPT = """
import sys, tempfile
from dataclasses import replace
from pathlib import Path
from problems_for_tests import config_of
from ge_torchrl.environments.kernels import recording, rollouts, soft_rollouts
from ge_torchrl.ge import mapping, operators
from ge_torchrl.run.experiment import run
from ge_torchrl.run.plan import plan
from ge_torchrl.run.warming import compile_kernels
from ge_torchrl.trees import reachable

kernels = [
    mapping._map, operators._mutate, reachable.keep_what_is_reached, rollouts.run_forest, recording.record_steps,
    soft_rollouts._fill,
]
ppo = {"max_timesteps": 40, "update_timesteps": 20}
everything = {"keep": 2, "episodes": 5, "neighbours": 2, "neighbours_drawn": 9, "migrants": 2, "final_keep": 1}
config = config_of(refiner={"method": "ppo", "ppo": ppo}, archive=everything)
compile_kernels(plan(config), "kernel")
before = [kernel.signatures for kernel in kernels]
assert all(before), before
run(config, Path(tempfile.mkdtemp()))
assert [kernel.signatures for kernel in kernels] == before
"""


def test_a_run_compiles_nothing_more():
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT],
        env={**os.environ, "PYTHONPATH": ":".join(sys.path)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    "another",
    [
        {"env": {"route": "gymnasium"}},
        {"grammar": {"splits": "oblique"}},
        {"refiner": {"method": "none"}, "polish": {"every": 0}},
    ],
    ids=["another route", "sums", "another refiner"],
)
def test_each_kind_of_run_compiles_its_kernels_before_its_clock_starts(another, tmp_path, monkeypatch):
    """A first run of other environments has compiled other kernels."""
    monkeypatch.setattr("ge_torchrl.compilation.cache_directory", lambda: tmp_path)
    first, second = plan(config_of(refiner={"method": "cmaes"})), plan(config_of(**another))
    assert is_first_of_its_kind(first)
    compile_kernels(first, "kernel")
    assert not is_first_of_its_kind(first)
    assert is_first_of_its_kind(second)
