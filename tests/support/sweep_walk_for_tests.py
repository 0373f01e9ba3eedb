"""A random walk that breaks off in its own way in the processes of a sweep, and never in the one that starts it."""

import contextlib
import os
import signal
from pathlib import Path

import gymnasium as gym
from environments_for_tests import WalkEnv

STARTED_BY = "SWEEP_STARTED_BY"
STATUS = Path("status.txt")


class SweepWalkEnv(WalkEnv):
    """Notes how far the sweep in `there` is, raises, or kills its process."""

    def __init__(self, how, **given):
        super().__init__(**given)
        self.how = how

    def reset(self, **given):
        if os.environ[STARTED_BY] != str(os.getpid()):
            self.break_off()
        return super().reset(**given)

    def break_off(self):
        if self.how == "raises":
            raise RuntimeError("the motor is on fire")
        if self.how == "dies":
            os.kill(os.getpid(), signal.SIGKILL)
        if not STATUS.exists() and any(Path("there").glob("0_*/config.yaml")):
            from ge_torchrl.cli.following import status

            with STATUS.open("w") as file, contextlib.redirect_stdout(file):
                status(["there"])


gym.register("SweepWalk-v0", entry_point=SweepWalkEnv, max_episode_steps=20)
