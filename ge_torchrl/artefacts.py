"""What a run leaves on disk, in and out: YAML, JSON and JSON lines, nothing that executes when read.

| file | content |
|---|---|
| `config.yaml` | the run's whole configuration |
| `history.jsonl` | a `GenerationRecord` for each generation |
| `best_tree.json` | the champion, pruned |
| `best_tree_full.json` | the champion as its genotype maps to it |
| `best_tree.txt` | the pruned champion for a person |
| `refinements.jsonl` | a `RefinementRecord` for each refinement of an individual |
| `hall_of_fame.jsonl` | a `HallOfFameRecord` for each number of decision nodes |
| `hall_of_fame/03.json` | the best tree with 3 decision nodes, pruned; likewise for the other sizes |
| `summary.json` | the `Summary` |
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import MISSING, asdict, fields
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self, TypeVar

import yaml

from ge_torchrl.config import Config
from ge_torchrl.errors import ArtefactError
from ge_torchrl.records import GenerationRecord, HallOfFameRecord, RefinementRecord, Summary
from ge_torchrl.trees.serialization import TreeDocument, read_tree, write_tree

CONFIG, HISTORY, REFINEMENTS, SUMMARY = "config.yaml", "history.jsonl", "refinements.jsonl", "summary.json"
BEST_TREE, BEST_TREE_FULL, BEST_TREE_TEXT = "best_tree.json", "best_tree_full.json", "best_tree.txt"
HALL_OF_FAME, HALL_OF_FAME_TREES = "hall_of_fame.jsonl", "hall_of_fame"

_Record = TypeVar("_Record", GenerationRecord, RefinementRecord, HallOfFameRecord, Summary)


class RunFolder:
    """The folder of one run.

    Args:
        path: The folder; `create` makes it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    @classmethod
    def create(cls, path: Path, config: Config) -> Self:
        """Make the folder and write the configuration into it.

        Raises:
            ArtefactError: The folder holds a run already, or cannot be written.
        """
        if (path / SUMMARY).exists() or (path / HISTORY).exists():
            raise ArtefactError(
                f"hydra.run.dir must be a folder without a run, so that nothing is lost; {path} holds one already"
            )
        try:
            path.mkdir(parents=True, exist_ok=True)
            (path / CONFIG).write_text(
                yaml.safe_dump(config.as_mapping(), sort_keys=False, allow_unicode=True), encoding="utf-8"
            )
        except OSError as error:
            raise ArtefactError(f"the run folder {path} cannot be written: {error.strerror}") from error
        return cls(path)

    def history_writer(self) -> RecordWriter:
        """Open the history for writing, record by record."""
        return RecordWriter(self.path / HISTORY)

    def refinements_writer(self) -> RecordWriter:
        """Open the refinements for writing, record by record."""
        return RecordWriter(self.path / REFINEMENTS)

    def write_trees(self, pruned: TreeDocument, full: TreeDocument, text: str) -> None:
        """Write the champion, as a file, in full, and for a person."""
        write_tree(self.path / BEST_TREE, pruned)
        write_tree(self.path / BEST_TREE_FULL, full)
        (self.path / BEST_TREE_TEXT).write_text(text, encoding="utf-8")

    def write_hall_of_fame(self, members: Sequence[tuple[HallOfFameRecord, TreeDocument]]) -> None:
        """Write the best trees of all sizes, first their files and then the table that names them."""
        (self.path / HALL_OF_FAME_TREES).mkdir(exist_ok=True)
        for record, document in members:
            write_tree(self._hall_of_fame_tree(record.decision_nodes), document)
        with RecordWriter(self.path / HALL_OF_FAME) as writer:
            for record, _ in members:
                writer.write(record)

    def write_summary(self, summary: Summary) -> None:
        """Write the summary."""
        text = json.dumps(asdict(summary), indent=2, allow_nan=False)
        (self.path / SUMMARY).write_text(text + "\n", encoding="utf-8")

    def read_config(self) -> Config:
        """Read the configuration.

        Raises:
            ArtefactError: There is none, or it is not YAML.
            ConfigError: It is not a configuration.
        """
        try:
            values = yaml.safe_load(_read(self.path / CONFIG))
        except yaml.YAMLError as error:
            raise ArtefactError(f"{self.path / CONFIG} is not YAML: {error}") from error
        return Config.from_mapping(values)

    def read_history(self) -> list[GenerationRecord]:
        """Read all generations.

        Raises:
            ArtefactError: There is no history, or a line is not a record.
        """
        return _records(GenerationRecord, self.path / HISTORY)

    def read_refinements(self) -> list[RefinementRecord]:
        """Read all applications of PPO.

        Raises:
            ArtefactError: There is no such file, or a line is not a record.
        """
        return _records(RefinementRecord, self.path / REFINEMENTS)

    def read_hall_of_fame(self) -> list[HallOfFameRecord]:
        """Read the table of the best trees, from small to large; it is empty where the run kept none.

        Raises:
            ArtefactError: A line is not a record.
        """
        path = self.path / HALL_OF_FAME
        return _records(HallOfFameRecord, path) if path.exists() else []

    def read_hall_of_fame_tree(self, decision_nodes: int) -> TreeDocument:
        """Read the best tree with so many decision nodes.

        Raises:
            ArtefactError: The run has no hall of fame, or none of that size in it.
            InvalidTreeError: The file holds no valid tree.
        """
        sizes = [record.decision_nodes for record in self.read_hall_of_fame()]
        if not sizes:
            raise ArtefactError(
                f"{self.path} must hold a hall of fame, as hall_of_fame.enabled=true makes it, to give a tree "
                f"with {decision_nodes} decision nodes; it holds none"
            )
        if decision_nodes not in sizes:
            raise ArtefactError(
                f"the number of decision nodes must be one of {', '.join(map(str, sizes))}, because the hall of fame "
                f"of {self.path} has these; got {decision_nodes}"
            )
        return read_tree(self._hall_of_fame_tree(decision_nodes))

    def _hall_of_fame_tree(self, decision_nodes: int) -> Path:
        return self.path / HALL_OF_FAME_TREES / f"{decision_nodes:02}.json"

    def read_summary(self) -> Summary:
        """Read the summary.

        Raises:
            ArtefactError: There is none, or it is not one.
        """
        return _record(Summary, _read(self.path / SUMMARY), str(self.path / SUMMARY))

    def read_tree(self) -> TreeDocument:
        """Read the pruned champion.

        Raises:
            ArtefactError: There is none.
            InvalidTreeError: The file holds no valid tree.
        """
        return read_tree(self.path / BEST_TREE)


class RecordWriter:
    """Writes records line by line, so that an interrupted run keeps what it had."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: IO[str] | None = None

    def __enter__(self) -> Self:
        self._file = self._path.open("w", encoding="utf-8", buffering=1)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._file is not None:
            self._file.close()

    def write(self, record: GenerationRecord | RefinementRecord | HallOfFameRecord) -> None:
        """Append one record."""
        if self._file is None:
            raise ValueError("records are written inside a with statement")
        self._file.write(json.dumps(asdict(record), allow_nan=False) + "\n")


def find_runs(folder: Path) -> Iterator[RunFolder]:
    """Yield the finished runs in a folder and below it, in the order of their paths."""
    for path in sorted(folder.rglob(SUMMARY)):
        yield RunFolder(path.parent)


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise ArtefactError(f"{path} cannot be read: {error.strerror}") from error


def _records(kind: type[_Record], path: Path) -> list[_Record]:
    return [_record(kind, line, f"{path}:{n}") for n, line in enumerate(_read(path).splitlines(), 1)]


def _record(kind: type[_Record], text: str, source: str) -> _Record:
    try:
        values: Any = json.loads(text)
    except json.JSONDecodeError as error:
        raise ArtefactError(f"{source} is not JSON: {error}") from error
    names = {field.name for field in fields(kind)}
    # A field with a default may be younger than the file.
    required = {field.name for field in fields(kind) if field.default is MISSING}
    if not isinstance(values, dict) or not required <= values.keys():
        missing = sorted(required - values.keys()) if isinstance(values, dict) else sorted(required)
        raise ArtefactError(
            f"{source} must be an object with every key of a {kind.__name__}; missing: {missing}"
        )
    return kind(**{name: values[name] for name in names & values.keys()})
