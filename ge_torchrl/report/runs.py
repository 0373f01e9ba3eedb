"""Finished runs as reports read them: everything that a folder holds, and by which method it was made."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from ge_torchrl.artefacts import BEST_TREE_FULL, HISTORY, RunFolder, find_runs
from ge_torchrl.config import Config
from ge_torchrl.errors import ArtefactError, UserError
from ge_torchrl.records import GenerationRecord, HallOfFameRecord, RefinementRecord, Summary
from ge_torchrl.report.methods import GE, GE_PPO, METHODS, method_of
from ge_torchrl.report.statistics import SolvingTime, solving_time
from ge_torchrl.trees.serialization import TreeDocument, read_tree


@dataclass(frozen=True)
class Run:
    """One finished run.

    Attributes:
        path: Its folder.
        config: Its configuration.
        summary: What it found.
        history: Its generations.
        refinements: Its refinements, skipped ones included; none in a run of GE alone.
        pruned: The champion.
        full: The champion as its genotype maps to it.
        hall_of_fame: Its best tree of each size, from small to large; none where it kept no hall of fame.
    """

    path: Path
    config: Config
    summary: Summary
    history: tuple[GenerationRecord, ...]
    refinements: tuple[RefinementRecord, ...]
    pruned: TreeDocument
    full: TreeDocument
    hall_of_fame: tuple[HallOfFameRecord, ...] = ()

    @property
    def method(self) -> str:
        """One of `METHODS`."""
        return method_of(self.config)

    @property
    def environment(self) -> str:
        """Gymnasium id."""
        return self.summary.environment

    @property
    def seed(self) -> int:
        """Seed of the run."""
        return self.summary.seed

    def solving_time(self, threshold: float) -> SolvingTime:
        """Return when the best fitness, refined trees included, reached a threshold."""
        return solving_time(self.history, threshold)


class Pair(NamedTuple):
    """Two runs of one environment and seed.

    Attributes:
        refined: The run with refined trees.
        plain: The run of GE alone.
    """

    refined: Run
    plain: Run

    @property
    def method(self) -> str:
        """The method of the run with refined trees."""
        return self.refined.method


class FoundRuns(NamedTuple):
    """What a folder holds.

    Attributes:
        runs: Runs in the order of environment, method as in `METHODS`, seed and path.
        unreadable: For every run that cannot be read one line that names it and says why.
    """

    runs: tuple[Run, ...]
    unreadable: tuple[str, ...]

    @classmethod
    def in_order(cls, runs: Iterable[Run], unreadable: Iterable[str]) -> FoundRuns:
        """Return these runs in their order."""

        def order(run: Run) -> tuple[str, int, int, Path]:
            return run.environment, METHODS.index(run.method), run.seed, run.path

        return cls(tuple(sorted(runs, key=order)), tuple(unreadable))


def read_runs(folder: Path) -> FoundRuns:
    """Read all finished runs in a folder and below it.

    Args:
        folder: A run's or a sweep's folder, or any above them.

    Raises:
        ArtefactError: There is no run, or none that can be read.
    """
    runs: list[Run] = []
    unreadable: list[str] = []
    for found in find_runs(folder):
        try:
            runs.append(read_run(found.path))
        except UserError as error:
            unreadable.append(f"{found.path}: {error}")
    if not runs:
        reason = f"; {unreadable[0]}" if unreadable else ""
        raise ArtefactError(f"expected a folder with finished runs; found none in {folder}{reason}")
    return FoundRuns.in_order(runs, unreadable)


def read_run(path: Path) -> Run:
    """Read one finished run.

    Raises:
        ArtefactError: A file is missing or unreadable.
        ConfigError: The configuration is none.
        InvalidTreeError: A tree's file holds no valid tree.
    """
    folder = RunFolder(path)
    config = folder.read_config()
    history = folder.read_history()
    if not history:
        raise ArtefactError(f"{path / HISTORY} must hold at least one generation; it is empty")
    return Run(
        path=path,
        config=config,
        summary=folder.read_summary(),
        history=tuple(history),
        refinements=tuple(folder.read_refinements()) if config.refiner.enabled else (),
        pruned=folder.read_tree(),
        full=read_tree(path / BEST_TREE_FULL),
        hall_of_fame=tuple(folder.read_hall_of_fame()),
    )


def pair_by_seed(runs: Sequence[Run], method: str = GE_PPO) -> tuple[Pair, ...]:
    """Return for every seed with a run of a method and one of GE alone that pair; of several of a seed the first.

    Args:
        runs: Runs of one environment.
        method: The method with refined trees.
    """
    first: dict[tuple[str, int], Run] = {}
    for run in runs:
        first.setdefault((run.method, run.seed), run)
    return tuple(
        Pair(first[method, seed], first[GE, seed])
        for seed in sorted({run.seed for run in runs})
        if (method, seed) in first and (GE, seed) in first
    )


def unequal_sections(pairs: Sequence[Pair]) -> tuple[str, ...]:
    """Return the sections of the configuration, the refiner's apart, in which the runs of some pair differ."""
    differing = {
        section
        for refined, plain in pairs
        for section, values in refined.config.as_mapping().items()
        if section != "refiner" and values != plain.config.as_mapping()[section]
    }
    return tuple(sorted(differing))
