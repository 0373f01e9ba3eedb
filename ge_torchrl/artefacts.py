"""What a run leaves on disk, in and out: YAML, JSON and JSON lines, nothing that executes when read.

| file | content |
|---|---|
| `config.yaml` | the run's whole configuration |
| `history.jsonl` | a `GenerationRecord` for each generation |
| `best_tree.json` | the champion, pruned |
| `best_tree_full.json` | the champion as its genotype maps to it |
| `best_tree.txt` | the pruned champion for a person |
| `refinements.jsonl` | a `RefinementRecord` for each application of PPO |
| `summary.json` | the `Summary` |
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self, TypeVar

import yaml

from ge_torchrl.config import Config
from ge_torchrl.errors import ArtefactError
from ge_torchrl.trees.serialization import TreeDocument, read_tree, write_tree

CONFIG, HISTORY, REFINEMENTS, SUMMARY = "config.yaml", "history.jsonl", "refinements.jsonl", "summary.json"
BEST_TREE, BEST_TREE_FULL, BEST_TREE_TEXT = "best_tree.json", "best_tree_full.json", "best_tree.txt"

# What the clock says differs from run to run; everything else is a function of configuration and seed (law 6).
CLOCK_FIELDS = frozenset(
    {
        "evolve_seconds",
        "wall_seconds",
        "elapsed_seconds",
        "evaluation_seconds",
        "variation_seconds",
        "refine_seconds",
    }
)


@dataclass(frozen=True)
class GenerationRecord:
    """One line of the history.

    Attributes:
        generation: 0 for the random first population.
        best_fitness: Of the whole population; None where no individual has a tree.
        best_refined: The best return that a refined tree was measured with so far; None before there is one.
        median_fitness: Of the individuals that have a tree.
        mean_fitness: Likewise.
        best_decision_nodes: Size of the fittest tree, without splits that no state can reach.
        born: Individuals made in this generation.
        invalid: Those of them without a tree.
        env_steps: Environment steps since the start of the run.
        elapsed_seconds: Clock time since the start of evolution.
        evaluation_seconds: Clock time of this generation's rollouts.
        variation_seconds: Clock time of its selection, variation and mapping.
    """

    generation: int
    best_fitness: float | None
    best_refined: float | None
    median_fitness: float | None
    mean_fitness: float | None
    best_decision_nodes: int | None
    born: int
    invalid: int
    env_steps: int
    elapsed_seconds: float
    evaluation_seconds: float
    variation_seconds: float


@dataclass(frozen=True)
class RefinementRecord:
    """One application of PPO to one tree; numbers are None where no candidate was found.

    Attributes:
        generation: After whose selection it happened.
        outcome: "improved" where the tree is better than before on the same unseen episodes, "not_improved",
            "failed" where training broke off, "skipped" where no candidate was found.
        chosen: "best" or "random", as the first draw was; None if skipped.
        redraws: Rejected candidates.
        individual: Index in the population of the tree that was refined.
        decision_nodes: Size of that tree.
        fitness_before: Its fitness on the training episodes.
        return_before: Its mean return on the measuring episodes.
        soft_return: Mean return of the soft tree's episodes in the last update.
        return_after: Mean return of the hardened tree on the measuring episodes.
        new_best: Whether that exceeds the generation's best fitness, refined trees included.
        thresholds_moved: Thresholds that changed.
        largest_threshold_move: Largest change of a threshold.
        leaves_changed: Leaves whose action changed.
        timesteps: Environment steps sampled.
        updates: Batches of samples.
        gradient_steps: Optimiser steps.
        actor_loss: Clipped surrogate at the last step.
        critic_loss: Value loss at the last step.
        clip_fraction: Share of clipped ratios at the last step.
        kl: Approximate divergence from the sampling policy at the last step.
        failure: What broke, or None.
        refine_seconds: Clock time.
    """

    generation: int
    outcome: str
    redraws: int
    chosen: str | None = None
    individual: int | None = None
    decision_nodes: int | None = None
    fitness_before: float | None = None
    return_before: float | None = None
    soft_return: float | None = None
    return_after: float | None = None
    new_best: bool = False
    thresholds_moved: int | None = None
    largest_threshold_move: float | None = None
    leaves_changed: int | None = None
    timesteps: int | None = None
    updates: int | None = None
    gradient_steps: int | None = None
    actor_loss: float | None = None
    critic_loss: float | None = None
    clip_fraction: float | None = None
    kl: float | None = None
    failure: str | None = None
    refine_seconds: float = 0.0


@dataclass(frozen=True)
class Summary:
    """What a run found; all that a table needs of it.

    Attributes:
        environment: Gymnasium id.
        seed: Seed of the run.
        solved: Whether the test mean reaches the environment's threshold; None where it has none.
        train_fitness: The champion's fitness on its few training episodes, as the thesis reports it.
        validation_mean: Its mean return on the validation episodes that chose it.
        test_mean: Mean return of the pruned champion on unseen episodes.
        test_std: Standard deviation of these returns.
        test_episodes: Their number.
        test_mean_full: Mean return of the unpruned champion on the same episodes: what pruning cost.
        decision_nodes: Of the pruned champion.
        depth: Of the pruned champion.
        complexity_M: Its complexity by Eq. 4.
        generations: Generations run, the first population included.
        stopped_by: "generations", "solved", "max_seconds", "max_env_steps" or "interrupt".
        env_steps: Environment steps of evolution and of refinements.
        env_steps_total: With validation, pruning and test.
        refinements: Applications of PPO to a tree, skipped ones not counted.
        refinements_improved: Those that made the tree better on the same unseen episodes.
        champion_from: "population", or "refinement" if the champion is a refined tree.
        evolve_seconds: Clock time of evolution, refinements included.
        refine_seconds: Clock time of the refinements.
        wall_seconds: Clock time of the whole run.
        invalid_fraction: Share of all individuals ever made that have no tree.
        route: "compiled" or "gymnasium".
        solved_at: The threshold, or None.
        version: Of ge_torchrl.
    """

    environment: str
    seed: int
    solved: bool | None
    train_fitness: float
    validation_mean: float
    test_mean: float
    test_std: float
    test_episodes: int
    test_mean_full: float
    decision_nodes: int
    depth: int
    complexity_M: float  # noqa: N815 (the paper's symbol)
    generations: int
    stopped_by: str
    env_steps: int
    env_steps_total: int
    refinements: int
    refinements_improved: int
    champion_from: str
    evolve_seconds: float
    refine_seconds: float
    wall_seconds: float
    invalid_fraction: float
    route: str
    solved_at: float | None
    version: str


_Record = TypeVar("_Record", GenerationRecord, RefinementRecord, Summary)


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

    def write(self, record: GenerationRecord | RefinementRecord) -> None:
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
    if not isinstance(values, dict) or not names <= values.keys():
        missing = sorted(names - values.keys()) if isinstance(values, dict) else sorted(names)
        raise ArtefactError(
            f"{source} must be an object with every key of a {kind.__name__}; missing: {missing}"
        )
    return kind(**{name: values[name] for name in names})
