"""How often a run writes from where it can go on, and the best trees so far."""

from __future__ import annotations

import time
from collections.abc import Callable

from ge_torchrl.artefacts.checkpoints import Checkpoint
from ge_torchrl.artefacts.memory import Artefacts

# Each of the two is done again when the run has gone on for so many times as long as it took.
_TIMES = 200


class Checkpointing:
    """Writes a run's checkpoints and its trees, which together take a hundredth of its time at most.

    Args:
        artefacts: Where to.
        save_trees: Saves the best trees so far, which others may read while the run goes on.
    """

    def __init__(self, artefacts: Artefacts, save_trees: Callable[[], object]) -> None:
        self._artefacts = artefacts
        self._tasks: dict[Callable[[], object], float] = {self.write: 0.0, save_trees: 0.0}
        self._newest: Checkpoint | None = None

    def note(self, checkpoint: Checkpoint) -> None:
        """Take notice of where the run stands, and write what is due.

        Raises:
            ArtefactError: It cannot be written.
        """
        if self._artefacts.path is None:
            return  # Nothing is left of memory when a run is broken off.
        self._newest = checkpoint
        for task, due in self._tasks.items():
            started = time.perf_counter()
            if started >= due:
                task()
                now = time.perf_counter()
                self._tasks[task] = now + _TIMES * (now - started)

    def write(self) -> None:
        """Write where the run stood last, if that is not written yet.

        Raises:
            ArtefactError: It cannot be written.
        """
        if self._newest is not None:
            self._artefacts.write_checkpoint(self._newest)
            self._newest = None
