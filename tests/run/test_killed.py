"""Runs that are killed (SIGKILL) at random instants, with each refiner, on kernels and on Gymnasium (law 8)."""

import os
import subprocess
import sys

import kills_for_tests
import pytest
from pages_for_tests import ROOT


@pytest.mark.skipif(
    not hasattr(os, "fork"), reason="runs are forked from one process that has loaded everything"
)
@pytest.mark.parametrize("number", [20, pytest.param(100, marks=pytest.mark.slow)])
def test_each_goes_on_and_ends_as_the_run_left_alone(number, tmp_path, tried):
    done = subprocess.run(
        [sys.executable, kills_for_tests.__file__, tmp_path, str(number)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests" / "support")])},
        capture_output=True,
        text=True,
        check=False,
    )
    # Each ends as the run left alone, or the program stops there.
    tried("runs killed at random instants", number, 1 if done.returncode else 0)
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{number} kills, 10 kinds of runs, all ends alike\n"
