"""The folder of a run, in and out: YAML, JSON and JSON lines, nothing that executes when read.

| file | content |
|---|---|
| `config.yaml` | the run's whole configuration |
| `history.jsonl` | a `GenerationRecord` for each generation |
| `refinements.jsonl` | a `RefinementRecord` for each tree that the refiner refined |
| `best_tree.json` | the champion, pruned |
| `best_tree_full.json` | the champion as its genotype maps to it |
| `best_tree.txt` | the pruned champion for a person |
| `archive.jsonl` | an `ArchiveRecord` for each number of decision nodes |
| `archive/03.json` | the best tree with 3 decision nodes, pruned; likewise for the other sizes |
| `episodes.json` | some test episodes step by step, and how often each leaf decided in all of them |
| `summary.json` | the `Summary`; a folder that holds it is a finished run |
| `report.html` | all of it as a page to look at |

The history and the refinements grow line by line. Every other file is there whole or not at all, and may be written
again while a run goes on.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Self

import yaml

from ge_torchrl.artefacts.episodes import Episodes, episodes_text, read_episodes
from ge_torchrl.artefacts.lines import RecordWriter, read_record, read_records, to_json
from ge_torchrl.artefacts.records import ArchiveRecord, GenerationRecord, RefinementRecord, Summary
from ge_torchrl.artefacts.texts import told_of, write_text, write_whole
from ge_torchrl.config import Config, without_gone
from ge_torchrl.errors import ArtefactError
from ge_torchrl.reading import MOST_SETTINGS_BYTES, is_there, read_text, yaml_of
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.files import read_controller, write_controller

CONFIG, HISTORY, REFINEMENTS, SUMMARY = "config.yaml", "history.jsonl", "refinements.jsonl", "summary.json"
BEST_TREE, BEST_TREE_FULL, BEST_TREE_TEXT = "best_tree.json", "best_tree_full.json", "best_tree.txt"
ARCHIVE, ARCHIVE_TREES = "archive.jsonl", "archive"
TRACEBACK = "traceback.txt"
EPISODES, PAGE = "episodes.json", "report.html"


# YAML takes them for line ends too, and would read another text.
_ODD_LINE_ENDS = "\r\x85\u2028\u2029"


class _BlockDumper(yaml.SafeDumper):
    """Writes a text of several lines, such as a grammar, as a block of lines."""

    def represent_lines(self, text: str) -> yaml.ScalarNode:
        """Represent a text; what a block cannot hold exactly is quoted."""
        style = '"' if any(end in text for end in _ODD_LINE_ENDS) else "|" if "\n" in text else None
        return self.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_BlockDumper.add_representer(str, _BlockDumper.represent_lines)


class RunFolder:
    """The folder of one run.

    Args:
        path: The folder; `create` makes it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def __str__(self) -> str:
        return str(self.path)

    @classmethod
    def create(cls, path: Path, config: Config, key: str = "hydra.run.dir") -> Self:
        """Make the folder and write the configuration into it.

        Args:
            path: The folder; it may exist, but must hold no run.
            config: The run's configuration.
            key: What the user calls the folder.

        Raises:
            ArtefactError: The folder holds a run already, or cannot be written.
        """
        if (path / SUMMARY).exists() or (path / HISTORY).exists():
            raise ArtefactError(
                f"{key} must be a folder without a run, so that nothing is lost; {path} holds one already"
            )
        folder = cls(path)
        try:
            with told_of(path):
                path.mkdir(parents=True, exist_ok=True)
            folder.write_config(config)
        except ArtefactError as error:
            raise ArtefactError(
                f"{key} must be a folder that can be written, because a run leaves its files there; {error}"
            ) from error
        return folder

    def history_writer(self) -> RecordWriter:
        """Open the history for writing, record by record."""
        return RecordWriter(self.path / HISTORY)

    def refinements_writer(self) -> RecordWriter:
        """Open the refinements for writing, record by record."""
        return RecordWriter(self.path / REFINEMENTS)

    def write_config(self, config: Config) -> None:
        """Write the configuration, again where the run has measured what was left open."""
        text = yaml.dump(config.as_mapping(), Dumper=_BlockDumper, sort_keys=False, allow_unicode=True)
        write_text(self.path / CONFIG, text)

    def write_trees(self, pruned: Controller, full: Controller, text: str) -> None:
        """Write the champion, as a file, in full, and for a person."""
        _write_tree(self.path / BEST_TREE, pruned)
        _write_tree(self.path / BEST_TREE_FULL, full)
        write_text(self.path / BEST_TREE_TEXT, text)

    def write_archive(self, members: Sequence[tuple[ArchiveRecord, Controller]]) -> None:
        """Write the best trees of all sizes, first their files and then the table that names them.

        Args:
            members: From small to large, one of a size. Files of sizes that are not among them are removed.
        """
        with told_of(self.path / ARCHIVE_TREES):
            (self.path / ARCHIVE_TREES).mkdir(exist_ok=True)
        paths = [self._archive_tree(record.decision_nodes) for record, _ in members]
        for path, (_, controller) in zip(paths, members, strict=True):
            _write_tree(path, controller)
        write_text(self.path / ARCHIVE, "".join(to_json(record) for record, _ in members))
        for stale in set((self.path / ARCHIVE_TREES).glob("*.json")).difference(paths):
            with told_of(stale):
                stale.unlink()

    def write_episodes(self, episodes: Episodes) -> None:
        """Write what the test saw."""
        write_text(self.path / EPISODES, episodes_text(episodes))

    def write_summary(self, summary: Summary) -> None:
        """Write the summary, the last file of a run."""
        write_text(self.path / SUMMARY, to_json(summary, indent=2))

    def write_traceback(self, text: str) -> str:
        """Write the details of a fault, and return what to say of them."""
        path = self.path / TRACEBACK
        write_text(path, text)
        return f"; details are in {path}"

    def read_config(self) -> Config:
        """Read the configuration; keys that are gone since are left out.

        Raises:
            ArtefactError: There is none, or it is not YAML.
            ConfigError: It is not a configuration.
        """
        try:
            values = yaml_of(read_text(self.path / CONFIG, MOST_SETTINGS_BYTES))
        except ValueError as error:
            raise ArtefactError(f"{self.path / CONFIG} is not YAML: {error}") from error
        return Config.from_mapping(without_gone(values))

    def read_history(self) -> list[GenerationRecord]:
        """Read all generations.

        Raises:
            ArtefactError: There is no history, or a line is not a record.
        """
        return read_records(GenerationRecord, self.path / HISTORY)

    def read_refinements(self) -> list[RefinementRecord]:
        """Read all refinements.

        Raises:
            ArtefactError: There is no such file, or a line is not a record.
        """
        return read_records(RefinementRecord, self.path / REFINEMENTS)

    def read_archive(self) -> list[ArchiveRecord]:
        """Read the table of the best trees, from small to large; it is empty where the run kept none.

        Raises:
            ArtefactError: A line is not a record.
        """
        path = self.path / ARCHIVE
        return read_records(ArchiveRecord, path) if is_there(path) else []

    def read_archive_tree(self, decision_nodes: int) -> Controller:
        """Read the best tree with so many decision nodes.

        Raises:
            ArtefactError: The run has no archive, or no tree of that size in it.
            InvalidTreeError: The file holds no valid tree.
        """
        sizes = [record.decision_nodes for record in self.read_archive()]
        if not sizes:
            raise ArtefactError(
                f"{self.path} must hold an archive, as archive.keep above 0 makes it, to give a tree with "
                f"{decision_nodes} decision nodes; it holds none"
            )
        if decision_nodes not in sizes:
            raise ArtefactError(
                f"the number of decision nodes must be one of {', '.join(map(str, sizes))}, because the archive of "
                f"{self.path} has these; got {decision_nodes}"
            )
        return read_controller(self._archive_tree(decision_nodes))

    def read_episodes(self) -> Episodes | None:
        """Read what the test saw; None where the run kept nothing of it.

        Raises:
            ArtefactError: The file is not in its format.
        """
        path = self.path / EPISODES
        return read_episodes(path) if is_there(path) else None

    def read_summary(self) -> Summary:
        """Read the summary.

        Raises:
            ArtefactError: There is none, or it is not one.
        """
        return read_record(Summary, self.path / SUMMARY)

    def read_best_tree(self) -> Controller:
        """Read the pruned champion.

        Raises:
            ArtefactError: There is none.
            InvalidTreeError: The file holds no valid tree.
        """
        return read_controller(self.path / BEST_TREE)

    def read_best_tree_full(self) -> Controller:
        """Read the champion as its genotype maps to it.

        Raises:
            ArtefactError: There is none.
            InvalidTreeError: The file holds no valid tree.
        """
        return read_controller(self.path / BEST_TREE_FULL)

    def _archive_tree(self, decision_nodes: int) -> Path:
        return self.path / ARCHIVE_TREES / f"{decision_nodes:02}.json"


def find_runs(folder: Path) -> Iterator[RunFolder]:
    """Yield the finished runs in a folder and below it, in the order of their paths."""
    for path in sorted(folder.rglob(SUMMARY)):
        yield RunFolder(path.parent)


def none_found(folder: Path, unreadable: Sequence[str]) -> ArtefactError:
    """Return the error of a folder without a finished run that can be read.

    Args:
        folder: The folder.
        unreadable: For every finished run a line that says why it cannot be read.
    """
    reason = f"; {unreadable[0]}" if unreadable else ""
    unfinished = [
        path.parent for path in sorted(folder.rglob(HISTORY)) if not (path.parent / SUMMARY).exists()
    ]
    if unfinished and not unreadable:
        many = f", and {len(unfinished) - 1} more," * (len(unfinished) > 1)
        reason = f", but {unfinished[0]}{many} without {SUMMARY}: a run that goes on, or broke off"
    return ArtefactError(f"expected a folder with finished runs; found none in {folder}{reason}")


def _write_tree(path: Path, controller: Controller) -> None:
    write_whole(path, lambda beside: write_controller(beside, controller))
