"""One run of a trial: what its champion returns on episodes that the run has not seen, and that are no test."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rich.console import Console

from ge_torchrl.artefacts.memory import RunMemory
from ge_torchrl.artefacts.records import GenerationRecord
from ge_torchrl.config import Config
from ge_torchrl.errors import RunFaultError
from ge_torchrl.run.experiment import carry_out
from ge_torchrl.run.running import INTERRUPT
from ge_torchrl.search.state import SearchState
from ge_torchrl.trees.controller import Names
from ge_torchrl.tuning.task import tuning_seeds

# A run is looked at once on its way, when it has taken this part of its limit; its search has some 0.7 of it.
_LOOKED_AT = 1 / 3


@dataclass(frozen=True)
class Outcome:
    """What came of a run.

    Attributes:
        value: Mean return of its champion on the tuner's episodes.
        decision_nodes: Of the champion.
        env_steps: Steps of the environment that it took.
        warnings: What it said.
    """

    value: float
    decision_nodes: int
    env_steps: int
    warnings: tuple[str, ...] = ()


class EndedEarlyError(Exception):
    """A run that was not worth its end."""


def outcome_of(config: Config, ends: Callable[[float], bool]) -> Outcome:
    """Run a configuration, and return what came of it.

    Args:
        config: Of the run, with a limit.
        ends: Is asked once on the way whether the run is to end there, given the best mean return so far, on the
            archive's episodes.

    Raises:
        EndedEarlyError: It was to end.
        KeyboardInterrupt: It was interrupted.
        UserError: The configuration cannot be run, or the environment failed.
        RunFaultError: The run broke off by a fault of the program.
    """
    watching = _Watching(config, ends)
    try:
        finished = carry_out(config, RunMemory, Console(quiet=True), watching, tuning_seeds)
    except RunFaultError:
        if watching.is_ended:
            raise EndedEarlyError from None
        raise
    summary = finished.summary
    if summary.stopped_by == INTERRUPT:
        raise KeyboardInterrupt
    return Outcome(
        summary.test_mean, summary.decision_nodes, summary.env_steps_total, tuple(summary.warnings)
    )


class _Watching:
    """Asks once whether a run goes on."""

    def __init__(self, config: Config, ends: Callable[[float], bool]) -> None:
        self._steps, self._seconds = config.ge.max_env_steps, config.ge.max_seconds
        self._ends = ends
        self._best: float | None = None
        self._is_asked = False
        self.is_ended = False

    def __call__(self, record: GenerationRecord, state: SearchState, _names: Names) -> bool:
        # A start may have an empty archive, and none may be kept at all.
        kept = [member.archive_fitness for member in state.archive.members]
        found = max(kept, default=record.best)
        if found is not None:
            self._best = found if self._best is None else max(found, self._best)
        taken = max(
            record.env_steps / self._steps if self._steps else 0.0,
            record.elapsed_seconds / self._seconds if self._seconds else 0.0,
        )
        if self._best is None or self._is_asked or taken < _LOOKED_AT:
            return False
        self._is_asked = True
        self.is_ended = self._ends(self._best)
        if self.is_ended:
            # True would only end the search, and what follows it takes its time too.
            raise EndedEarlyError
        return False
