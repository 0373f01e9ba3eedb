"""Ctrl-C goes to all processes of a terminal at once, and impatient people press it often."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time

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


def test_workers_end_quietly_however_often_ctrl_c_is_pressed(tmp_path):
    (tmp_path / "own.py").write_text(MODULE)
    (tmp_path / "script.py").write_text(SCRIPT)
    program = subprocess.Popen(
        [sys.executable, "script.py"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    late = threading.Timer(120, os.killpg, [program.pid, signal.SIGKILL])
    late.start()
    with program:
        said = program.stdout.readline
        assert (said(), said()) == ("stuck\n", "stuck\n")
        os.killpg(program.pid, signal.SIGINT)
        assert said() == "stopping\n"
        # Workers would be waited for, were it not for this one.
        os.killpg(program.pid, signal.SIGINT)
        assert said() == "leaving\n"
        for _ in range(5):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(program.pid, signal.SIGINT)
            time.sleep(0.02)
        output, errors = program.stdout.read(), program.stderr.read()
    late.cancel()
    assert (program.returncode, output, errors) == (130, "closed\n", "")
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
