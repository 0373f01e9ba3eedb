"""Ctrl-C goes to all processes of a terminal at once, and impatient people press it often."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time

import pytest
from pages_for_tests import ROOT

MODULE = """
import os
import time
import gymnasium as gym
import numpy as np

class Stuck(gym.Env):
    observation_space, action_space = gym.spaces.Box(0, 1, (1,), np.float32), gym.spaces.Discrete(2)
    quick = 300  # As many steps as the calling process makes to look at it.

    def reset(self, *, seed=None, options=None):
        return np.zeros(1, np.float32), {}

    def step(self, action):
        type(self).quick -= 1
        if self.quick < 0:
            os.write(1, b"stuck\\n")  # In one piece: two processes write it.
            time.sleep(600)
        return np.zeros(1, np.float32), 0.0, True, False, {}

gym.register("Stuck-v0", "own:Stuck")
"""
SCRIPT = """
import sys
import own
import numpy as np
from ge_torchrl.environments import gymnasium_backend, gymnasium_workers
from ge_torchrl.environments.spec import describe
from ge_torchrl.interrupts import ignore_interrupts, interrupt_again, leave_quietly
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

def main():
    leave_quietly()
    interrupt_again()
    gymnasium_backend._PROBED_STEPS = gymnasium_backend._TIMED_STEPS = 10
    backend, wait = gymnasium_backend.GymnasiumBackend(describe("own:Stuck-v0"), workers=2), gymnasium_workers.wait

    def told(futures, timeout, **more):
        if timeout == gymnasium_workers._STOP_SECONDS:
            print("stopping", flush=True)
        return wait(futures, timeout=timeout, **more)

    gymnasium_workers.wait = told
    try:
        backend.evaluate(Forest.stack([DecisionTree.leaf(0)]), np.arange(100_000), "test")
    except KeyboardInterrupt:
        ignore_interrupts()
        print("leaving", flush=True)
    finally:
        backend.close()
    print("closed", flush=True)
    return 130

if __name__ == "__main__":
    sys.exit(main())
"""


@contextlib.contextmanager
def playing(folder):
    """Start a program with two workers in a group of their own, and wait until both play."""
    (folder / "own.py").write_text(MODULE)
    (folder / "script.py").write_text(SCRIPT)
    program = subprocess.Popen(
        [sys.executable, "script.py"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    late = threading.Timer(120, os.killpg, [program.pid, signal.SIGKILL])
    late.start()
    try:
        with program:
            said = program.stdout.readline
            assert (said(), said()) == ("stuck\n", "stuck\n")
            yield program
    finally:
        late.cancel()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_workers_end_quietly_however_often_they_all_are_told_to(tmp_path, number):
    """A terminal tells all processes of Ctrl-C, and many a scheduler all of a job of its end."""
    with playing(tmp_path) as program:
        said = program.stdout.readline
        os.killpg(program.pid, number)
        assert said() == "stopping\n"
        # Workers would be waited for, were it not for this one.
        os.killpg(program.pid, number)
        assert said() == "leaving\n"
        for _ in range(5):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(program.pid, number)
            time.sleep(0.02)
        output, errors = program.stdout.read(), program.stderr.read()
    assert (program.returncode, output, errors) == (130, "closed\n", "")
    assert is_gone(program.pid)


def test_workers_end_when_the_program_is_killed(tmp_path):
    with playing(tmp_path) as program:
        program.kill()
        program.wait()
        assert is_gone(program.pid)


def is_gone(group):
    """Tell whether no process of a group is left, soon."""
    for _ in range(100):
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.1)
    return False
