"""What is told of a worker process that ended by itself, or in which nothing comes back."""

from __future__ import annotations

import os
import sys
import time
from multiprocessing.context import SpawnContext
from typing import Any, NamedTuple

from ge_torchrl.environments.hangs import GRACE_SECONDS, watch_as_worker
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.interrupts import interrupt_in_worker

_LONGEST_WORDS = 1000
# Between two looks at workers [s].
_LONGEST_LOOK = 1.0


class Words(NamedTuple):
    """What workers and the process that started them share, to know of hangs.

    Attributes:
        beats: By the clock of `time.monotonic`, when each worker last ran Python; 0 before it does.
        told: What does not come back in one that has ended itself.
    """

    beats: Any
    told: Any

    @classmethod
    def empty(cls, context: SpawnContext, n_workers: int) -> Words:
        """Return them for workers that are to be started."""
        return cls(context.RawArray("d", n_workers), context.RawArray("c", _LONGEST_WORDS))

    def kept(self, place: int) -> None:
        """Keep them from now on, in the process of a worker."""

        def beat() -> None:
            self.beats[place] = time.monotonic()

        def give_up(hung: str) -> None:
            self.told.value = hung.encode(errors="replace")[: _LONGEST_WORDS - 1]
            os._exit(1)

        interrupt_in_worker()
        beat()
        watch_as_worker(beat, give_up)


class Silence:
    """How long workers have run no Python, as the looks of the process count it that waits for them.

    A clock would count the time too in which all of them were stopped.

    Args:
        words: Of the workers.
        environment_id: Of their environment.
        step_seconds: How long a call of it may take [s].
    """

    def __init__(self, words: Words, environment_id: str, step_seconds: float) -> None:
        self._words, self._id, self._step_seconds = words, environment_id, step_seconds
        self._heard: list[float] = list(words.beats)
        self._seconds = [0.0] * len(self._heard)

    def check(self, seconds: float) -> None:
        """Look.

        Args:
            seconds: Since the last look.

        Raises:
            EnvironmentFaultError: One has been silent for longer than a call may take.
        """
        for place, beat in enumerate(self._words.beats):
            is_silent = beat == self._heard[place] and beat > 0
            # One look takes as much, however long this process was stopped.
            self._seconds[place] = self._seconds[place] + min(seconds, _LONGEST_LOOK) if is_silent else 0.0
            self._heard[place] = beat
        if max(self._seconds) >= self._step_seconds + GRACE_SECONDS:
            raise EnvironmentFaultError(
                f"env.id={self._id} must return from every call within {self._step_seconds:g} s, as env.step_seconds "
                "sets it; one has not, in compiled code of a worker process"
            )


def worker_died(environment_id: str, words: Words) -> EnvironmentFaultError:
    """Return the error of a worker process that ended by itself."""
    if words.told.value:
        return EnvironmentFaultError(words.told.value.decode(errors="replace"))
    main = sys.modules["__main__"]
    is_script = getattr(main, "__file__", None) is not None and getattr(main, "__spec__", None) is None
    script = (
        '; a script needs its calls below if __name__ == "__main__":, since workers read it too' * is_script
    )
    return EnvironmentFaultError(
        f"a worker process of env.id={environment_id} died; env.workers=1 runs the environment in this process, "
        f"where its last words can be read{script}"
    )
