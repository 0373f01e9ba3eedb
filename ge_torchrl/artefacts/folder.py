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
| `summary.json` | the `Summary`, and the SHA-256 of all files above; a folder that holds it is a finished run |
| `report.html` | all of it as a page to look at |
| `checkpoints/` | from which a run goes on that did not come to its end |

The history and the refinements grow line by line. Every other file is there whole or not at all, and may be written
again while a run goes on. Whoever reads a file of a finished run learns whether it is still what the run wrote.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from ge_torchrl.artefacts.episodes import Episodes, episodes_text, read_episodes
from ge_torchrl.artefacts.journal import CONFIG, HISTORY, REFINEMENTS, SUMMARY, TRACEBACK, Journal
from ge_torchrl.artefacts.lines import CHECKSUM, read_record, read_records, read_sums, summary_text, to_json
from ge_torchrl.artefacts.records import ArchiveRecord, GenerationRecord, RefinementRecord, Summary
from ge_torchrl.artefacts.sums import SUMS, check_sum, sums_of
from ge_torchrl.artefacts.texts import told_of, write_text
from ge_torchrl.config import Config, without_gone
from ge_torchrl.errors import ArtefactError
from ge_torchrl.reading import MOST_SETTINGS_BYTES, is_folder, is_there, name_of, read_text, yaml_of
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.files import read_controller
from ge_torchrl.trees.files import to_json as tree_to_json

__all__ = [
    "ARCHIVE",
    "ARCHIVE_TREES",
    "BEST_TREE",
    "BEST_TREE_FULL",
    "BEST_TREE_TEXT",
    "CONFIG",
    "EPISODES",
    "HISTORY",
    "PAGE",
    "REFINEMENTS",
    "SUMMARY",
    "TRACEBACK",
    "RunFolder",
    "find_runs",
    "none_found",
]

BEST_TREE, BEST_TREE_FULL, BEST_TREE_TEXT = "best_tree.json", "best_tree_full.json", "best_tree.txt"
ARCHIVE, ARCHIVE_TREES = "archive.jsonl", "archive"
EPISODES, PAGE = "episodes.json", "report.html"

_LISTED = (
    CONFIG, HISTORY, REFINEMENTS, BEST_TREE, BEST_TREE_FULL, BEST_TREE_TEXT, ARCHIVE, ARCHIVE_TREES, EPISODES,
)  # fmt: skip
_OF_TREES = "copy it to another folder, where it is read as it is"
_OF_OTHERS = f"remove the keys {SUMS} and {CHECKSUM} of {SUMMARY}: then the folder is read as it is"


class RunFolder(Journal):
    """The folder of one run.

    Args:
        path: The folder; `create` makes it.
    """

    WRITTEN = (
        *Journal.WRITTEN, BEST_TREE, BEST_TREE_FULL, BEST_TREE_TEXT, ARCHIVE, ARCHIVE_TREES, EPISODES, PAGE,
    )  # fmt: skip

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._written: dict[Path, str] = {}

    def __str__(self) -> str:
        return str(self.path)

    def write_trees(self, pruned: Controller, full: Controller, text: str) -> None:
        """Write the champion, as a file, in full, and for a person."""
        self._write(self.path / BEST_TREE, tree_to_json(pruned))
        self._write(self.path / BEST_TREE_FULL, tree_to_json(full))
        self._write(self.path / BEST_TREE_TEXT, text)

    def write_archive(self, members: Sequence[tuple[ArchiveRecord, Controller]]) -> None:
        """Write the best trees of all sizes, first their files and then the table that names them.

        Args:
            members: From small to large, one of a size. Files of sizes that are not among them are removed.
        """
        with told_of(self.path / ARCHIVE_TREES):
            (self.path / ARCHIVE_TREES).mkdir(exist_ok=True)
        paths = [self._archive_tree(record.decision_nodes) for record, _ in members]
        for path, (_, controller) in zip(paths, members, strict=True):
            self._write(path, tree_to_json(controller))
        self._write(self.path / ARCHIVE, "".join(to_json(record) for record, _ in members))
        for stale in set((self.path / ARCHIVE_TREES).glob("*.json")).difference(paths):
            with told_of(stale):
                stale.unlink()
            self._written.pop(stale, None)

    def _write(self, path: Path, text: str) -> None:
        """Write a text that a run writes again and again, where it has changed."""
        if self._written.get(path) != text:
            write_text(path, text)
            self._written[path] = text

    def write_episodes(self, episodes: Episodes) -> None:
        """Write what the test saw."""
        write_text(self.path / EPISODES, episodes_text(episodes))

    def write_summary(self, summary: Summary) -> None:
        """Write the summary, the last file of a run: what the others hold is listed there."""
        write_text(self.path / SUMMARY, summary_text(summary, sums_of(self.path, _LISTED)))

    def checked(self, name: str) -> Path:
        """Return the path of a file, which is what the run wrote, if the run is finished; it need not be there else.

        Args:
            name: The file's path below the folder.

        Raises:
            ArtefactError: It is not, or it is gone, or the summary is damaged.
        """
        summary = self.path / SUMMARY
        if is_there(summary):
            is_tree = name in (BEST_TREE, BEST_TREE_FULL) or name.startswith(ARCHIVE_TREES + "/")
            check_sum(self.path, name, read_sums(summary), remedy=_OF_TREES if is_tree else _OF_OTHERS)
        return self.path / name

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
            values = yaml_of(read_text(self.checked(CONFIG), MOST_SETTINGS_BYTES))
        except ValueError as error:
            raise ArtefactError(f"{self.path / CONFIG} is not YAML: {error}") from error
        return Config.from_mapping(without_gone(values))

    def read_history(self) -> list[GenerationRecord]:
        """Read all generations.

        Raises:
            ArtefactError: There is no history, or a line is not a record.
        """
        return read_records(GenerationRecord, self.checked(HISTORY))

    def read_refinements(self) -> list[RefinementRecord]:
        """Read all refinements.

        Raises:
            ArtefactError: There is no such file, or a line is not a record.
        """
        return read_records(RefinementRecord, self.checked(REFINEMENTS))

    def read_archive(self) -> list[ArchiveRecord]:
        """Read the table of the best trees, from small to large; it is empty where the run kept none.

        Raises:
            ArtefactError: A line is not a record.
        """
        path = self.checked(ARCHIVE)
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
        path = self._archive_tree(decision_nodes)
        return read_controller(self.checked(path.relative_to(self.path).as_posix()))

    def read_episodes(self) -> Episodes | None:
        """Read what the test saw; None where the run kept nothing of it.

        Raises:
            ArtefactError: The file is not in its format.
        """
        path = self.checked(EPISODES)
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
        return read_controller(self.checked(BEST_TREE))

    def read_best_tree_full(self) -> Controller:
        """Read the champion as its genotype maps to it.

        Raises:
            ArtefactError: There is none.
            InvalidTreeError: The file holds no valid tree.
        """
        return read_controller(self.checked(BEST_TREE_FULL))

    def _archive_tree(self, decision_nodes: int) -> Path:
        return self.path / ARCHIVE_TREES / f"{decision_nodes:02}.json"


def find_runs(folder: Path) -> Iterator[RunFolder]:
    """Yield the finished runs in a folder and below it, in the order of their paths."""
    for path in sorted(folder.rglob(SUMMARY)) if is_folder(folder) else ():
        yield RunFolder(path.parent)


def _histories(folder: Path) -> list[Path]:
    return sorted(folder.rglob(HISTORY)) if is_folder(folder) else []


def none_found(folder: Path, unreadable: Sequence[str]) -> ArtefactError:
    """Return the error of a folder without a finished run that can be read.

    Args:
        folder: The folder.
        unreadable: For every finished run a line that says why it cannot be read.
    """
    reason = f"; {unreadable[0]}" if unreadable else ""
    unfinished = [path.parent for path in _histories(folder) if not (path.parent / SUMMARY).exists()]
    if unfinished and not unreadable:
        many = f", and {len(unfinished) - 1} more," * (len(unfinished) > 1)
        reason = (
            f", but {unfinished[0]}{many} without {SUMMARY}: a run that goes on, or broke off; report "
            f"{unfinished[0]} tells what it has found so far"
        )
    return ArtefactError(f"expected a folder with finished runs; found none in {name_of(folder)}{reason}")
