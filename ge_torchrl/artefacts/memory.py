"""A run that leaves no files: what the folder of a run would hold, kept in memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import Any, Generic, Protocol, TypeVar

from ge_torchrl.artefacts.checkpoints import Checkpoint
from ge_torchrl.artefacts.episodes import Episodes
from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.artefacts.lines import Mark
from ge_torchrl.artefacts.records import ArchiveRecord, GenerationRecord, RefinementRecord, Summary
from ge_torchrl.config import Config
from ge_torchrl.errors import ArtefactError
from ge_torchrl.trees.controller import Controller, Names

_Record = TypeVar("_Record", GenerationRecord, RefinementRecord)


class Records(Protocol):
    """Takes records one by one."""

    def write(self, record: Any) -> None:
        """Append one record."""


@dataclass(frozen=True)
class _Lines(Generic[_Record]):
    records: list[_Record]

    def write(self, record: _Record) -> None:
        self.records.append(record)


@dataclass(eq=False)
class RunMemory:
    """What one run leaves, written and read as a `RunFolder` is.

    Args:
        config: The run's configuration.
    """

    config: Config
    _history: list[GenerationRecord] = field(default_factory=list)
    _refinements: list[RefinementRecord] = field(default_factory=list)
    _trees: tuple[Controller, Controller] | None = None
    _archive: tuple[tuple[ArchiveRecord, Controller], ...] = ()
    _episodes: Episodes | None = None
    _summary: Summary | None = None

    def __str__(self) -> str:
        # Where an error that ends a run carries what there is.
        return "error.champion"

    @property
    def path(self) -> None:
        """Where it lies: nowhere."""
        return

    @property
    def lines(self) -> dict[str, Mark]:
        """How far each file of records is written: there are none."""
        return {}

    def begin(self, names: Names, told: Callable[[str], None]) -> Checkpoint | None:  # noqa: ARG002 (as a folder's)
        """Return from where the run goes on: it begins."""
        return None

    def write_checkpoint(self, checkpoint: Checkpoint) -> None:
        """Write nothing, since nothing is left of memory when a run is broken off."""

    def finish(self) -> None:
        """Remove what only a run needs that goes on: nothing."""

    def release(self) -> None:
        """Let other processes write: none can."""

    def history_writer(self) -> AbstractContextManager[Records]:
        """Open the history for writing, record by record."""
        return nullcontext(_Lines(self._history))

    def refinements_writer(self) -> AbstractContextManager[Records]:
        """Open the refinements for writing, record by record."""
        return nullcontext(_Lines(self._refinements))

    def write_trees(self, pruned: Controller, full: Controller, text: str) -> None:  # noqa: ARG002 (as a folder's)
        """Keep the champion, and the champion in full."""
        self._trees = pruned, full

    def write_archive(self, members: Sequence[tuple[ArchiveRecord, Controller]]) -> None:
        """Keep the best trees of all sizes, from small to large."""
        self._archive = tuple(members)

    def write_episodes(self, episodes: Episodes) -> None:
        """Keep what the test saw."""
        self._episodes = episodes

    def write_summary(self, summary: Summary) -> None:
        """Keep the summary, the last of a run."""
        self._summary = summary

    def write_traceback(self, text: str) -> str:  # noqa: ARG002 (as a folder's)
        """Leave the details of a fault to the error itself, which carries them; return what to say of them: nothing."""
        return ""

    def read_config(self) -> Config:
        """Return the configuration."""
        return self.config

    def read_history(self) -> list[GenerationRecord]:
        """Return all generations."""
        return list(self._history)

    def read_refinements(self) -> list[RefinementRecord]:
        """Return all refinements."""
        return list(self._refinements)

    def read_archive(self) -> list[ArchiveRecord]:
        """Return the table of the best trees, from small to large; it is empty where the run kept none."""
        return [record for record, _ in self._archive]

    def read_archive_tree(self, decision_nodes: int) -> Controller:
        """Return the best tree with so many decision nodes.

        Raises:
            ArtefactError: There is none.
        """
        for record, controller in self._archive:
            if record.decision_nodes == decision_nodes:
                return controller
        raise ArtefactError(f"the run kept no tree with {decision_nodes} decision nodes")

    def read_episodes(self) -> Episodes | None:
        """Return what the test saw; None where nothing of it was kept."""
        return self._episodes

    def read_summary(self) -> Summary:
        """Return the summary.

        Raises:
            ArtefactError: The run did not come to its end.
        """
        if self._summary is None:
            raise ArtefactError("the run has no summary, because it did not come to its end")
        return self._summary

    def read_best_tree(self) -> Controller:
        """Return the pruned champion.

        Raises:
            ArtefactError: There is none.
        """
        return self._champion()[0]

    def read_best_tree_full(self) -> Controller:
        """Return the champion as its genotype maps to it.

        Raises:
            ArtefactError: There is none.
        """
        return self._champion()[1]

    def _champion(self) -> tuple[Controller, Controller]:
        if self._trees is None:
            raise ArtefactError("the run has no tree yet")
        return self._trees


Artefacts = RunFolder | RunMemory
"""Where a run leaves what it finds."""
