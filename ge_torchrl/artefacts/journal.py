"""What a run writes as it goes on: its configuration, lines of records and checkpoints, under a lock."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, Self

from ge_torchrl.artefacts.blocks import as_yaml
from ge_torchrl.artefacts.checkpoints import (
    CHECKPOINTS,
    Checkpoint,
    config_of_checkpoints,
    has_checkpoints,
    remove_checkpoints,
    sound_checkpoint,
    write_checkpoint,
)
from ge_torchrl.artefacts.lines import Mark, RecordWriter
from ge_torchrl.artefacts.locks import Lock
from ge_torchrl.artefacts.texts import read_text, told_of, write_text
from ge_torchrl.artefacts.vacancy import check_vacant
from ge_torchrl.config import Config
from ge_torchrl.errors import ArtefactError
from ge_torchrl.trees.controller import Names

CONFIG, HISTORY, REFINEMENTS, SUMMARY = "config.yaml", "history.jsonl", "refinements.jsonl", "summary.json"
TRACEBACK = "traceback.txt"


class Journal:
    """The part of a run's folder that lets a run begin, and go on where it was broken off.

    Args:
        path: The folder; `create` makes it.

    Attributes:
        WRITTEN: Names of what a run writes there.
    """

    WRITTEN: ClassVar[tuple[str, ...]] = (SUMMARY, HISTORY, CONFIG, REFINEMENTS, CHECKPOINTS)

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock: Lock | None = None
        self._is_reopened = False
        self._begins_at: Mapping[str, Mark] = {}
        self._writers: dict[str, RecordWriter] = {}

    @classmethod
    def create(cls, path: Path, config: Config, key: str = "hydra.run.dir") -> Self:
        """Make the folder and write the configuration into it; `release` lets other processes write there again.

        Args:
            path: The folder; it may exist, but must hold nothing that has the name of a file of a run.
            config: The run's configuration.
            key: What the user calls the folder.

        Raises:
            ArtefactError: The folder holds a run already, or cannot be written.
        """
        check_vacant(path, cls.WRITTEN, CONFIG, key)
        folder = cls(path)
        try:
            with told_of(path):
                path.mkdir(parents=True, exist_ok=True)
            folder.lock()
            folder.write_config(config)
        except ArtefactError as error:
            folder.release()
            raise ArtefactError(
                f"{key} must be a folder that can be written, because a run leaves its files there; {error}"
            ) from error
        return folder

    @classmethod
    def reopen(cls, path: Path) -> Self:
        """Take a folder in which a run did not come to its end; `begin` finds from where it goes on.

        Raises:
            ArtefactError: Another process runs it, or its configuration is gone or another one.
        """
        if not path.is_dir():
            raise ArtefactError(f"expected the folder of a run; there is none at {path}")
        folder = cls(path)
        folder.lock()
        try:
            folder._restore_config()
        except ArtefactError:
            folder.release()
            raise
        folder._is_reopened = True
        return folder

    def lock(self) -> None:
        """Keep other processes from writing into the folder.

        Raises:
            ArtefactError: Another process keeps this one.
        """
        self._lock = Lock(self.path)

    def release(self) -> None:
        """Let other processes write into the folder; it may be called again."""
        if self._lock is not None:
            self._lock.release()

    def begin(self, names: Names, told: Callable[[str], None]) -> Checkpoint | None:
        """Return from where the run goes on; None where it begins.

        Args:
            names: Of the environment.
            told: Is told, in a line each, of checkpoints that are passed over.

        Raises:
            ArtefactError: There is more of a run than it could go on from.
        """
        checkpoint = None
        if self._is_reopened:
            # A run is killed before its first checkpoint, or it has one.
            if has_checkpoints(self.path) or _has_lines(self.path / HISTORY):
                checkpoint = sound_checkpoint(self.path, names, told)
                self._begins_at = checkpoint.lines
            # What was interrupted was tested, and is no longer finished.
            for stale in (self.path / SUMMARY, self.path / TRACEBACK, *self.path.rglob(".*.partial")):
                with told_of(stale):
                    stale.unlink(missing_ok=True)
        return checkpoint

    def write_checkpoint(self, checkpoint: Checkpoint) -> None:
        """Write from where the run can go on, when the records that it counts on are on the disk.

        Raises:
            ArtefactError: It cannot be written.
        """
        for writer in self._writers.values():
            writer.settle()
        write_checkpoint(self.path, replace(checkpoint, config=read_text(self.path / CONFIG)))

    @property
    def lines(self) -> dict[str, Mark]:
        """How far each file of records is written."""
        return {name: writer.mark for name, writer in self._writers.items()}

    def finish(self) -> None:
        """Remove what only a run needs that goes on.

        Raises:
            ArtefactError: It cannot be removed.
        """
        remove_checkpoints(self.path)

    def history_writer(self) -> RecordWriter:
        """Open the history for writing, record by record."""
        return self._writer(HISTORY)

    def refinements_writer(self) -> RecordWriter:
        """Open the refinements for writing, record by record."""
        return self._writer(REFINEMENTS)

    def write_config(self, config: Config) -> None:
        """Write the configuration, again where the run has measured what was left open."""
        write_text(self.path / CONFIG, as_yaml(config.as_mapping()))

    def _writer(self, name: str) -> RecordWriter:
        self._writers[name] = RecordWriter(self.path / name, self._begins_at.get(name, Mark()))
        return self._writers[name]

    def _restore_config(self) -> None:
        path, kept = self.path / CONFIG, config_of_checkpoints(self.path)
        if not path.exists():
            if kept is None:
                raise ArtefactError(
                    f"{self.path} must be the folder of a run, to go on with it; it holds no {CONFIG}"
                )
            write_text(path, kept)
        elif kept not in (None, read_text(path)):
            raise ArtefactError(
                f"{path} must be what the run began with, to go on with it; it was changed, or is damaged; "
                "remove it, and the run writes it again"
            )


def _has_lines(path: Path) -> bool:
    """Tell whether there are more lines than those of a first generation."""
    return path.exists() and path.read_bytes().count(b"\n") > 1
