"""Finished runs as reports read them: everything that a folder holds, and by which method it was made."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from ge_torchrl.artefacts.folder import HISTORY, SUMMARY, RunFolder, find_runs, none_found
from ge_torchrl.artefacts.records import ArchiveRecord, GenerationRecord, RefinementRecord, Summary
from ge_torchrl.config import Config
from ge_torchrl.errors import ArtefactError, UserError
from ge_torchrl.report.measuring import Told, tell_nobody
from ge_torchrl.report.methods import METHODS, done_by, method_of
from ge_torchrl.report.settings import labels_of
from ge_torchrl.report.sizes import SizedTree, trees_of_archive
from ge_torchrl.report.tables import counted
from ge_torchrl.report.twins import Twin, twins_told, without_twins
from ge_torchrl.trees.controller import Controller, Names


@dataclass(frozen=True)
class Run:
    """One finished run.

    Attributes:
        path: Its folder.
        config: Its configuration.
        summary: What it found.
        history: Its generations.
        refinements: Its refinements, skipped ones included; none in a run without a refiner.
        pruned: The champion.
        full: The champion as its genotype maps to it.
        archive: Its best tree of each size, from small to large; none where it kept no archive.
        setting: What differs between it and the runs of its environment and method beside it, but the seed; empty
            where nothing does.
    """

    path: Path
    config: Config
    summary: Summary
    history: tuple[GenerationRecord, ...]
    refinements: tuple[RefinementRecord, ...]
    pruned: Controller
    full: Controller
    archive: tuple[ArchiveRecord, ...] = ()
    setting: str = ""

    @property
    def label(self) -> str:
        """The method, and after it the setting that tells runs of it apart."""
        return f"{self.method}, {self.setting}" if self.setting else self.method

    @property
    def method(self) -> str:
        """One of `METHODS`."""
        return method_of(self.config)

    @property
    def done(self) -> str:
        """By which method it searched in the end: "GE; PPO refined no tree" where that was never due."""
        return done_by(self.method, self.summary.refined, self.summary.polished)

    @property
    def names(self) -> Names:
        """Its environment, and the names of its features and actions."""
        return self.pruned.names

    @property
    def environment(self) -> str:
        """Its id, with what it was made with besides: runs of another gravity or limit are of another environment."""
        return self.names.environment

    @property
    def seed(self) -> int:
        """Seed of the run."""
        return self.summary.seed

    @property
    def by_size(self) -> Iterator[SizedTree]:
        """The tested trees of its archive."""
        return trees_of_archive(self.archive, self.seed, self.summary.decision_nodes)


class FoundRuns(NamedTuple):
    """What a folder holds.

    Attributes:
        runs: Runs in the order of environment, method as in `METHODS`, setting, seed and path.
        unreadable: For every run that cannot be read one line that names it and says why.
        twins: Runs that have the configuration and seed of one among `runs`.
    """

    runs: tuple[Run, ...]
    unreadable: tuple[str, ...]
    twins: tuple[Twin, ...] = ()

    @classmethod
    def in_order(
        cls, runs: Iterable[Run], unreadable: Iterable[str], twins: Iterable[Twin] = ()
    ) -> FoundRuns:
        """Return these runs in their order, each with the setting that tells it from others."""

        def order(run: Run) -> tuple[str, int, str, int, Path]:
            return run.environment, METHODS.index(run.method), run.setting, run.seed, run.path

        return cls(tuple(sorted(_told_apart(runs), key=order)), tuple(unreadable), tuple(twins))

    @property
    def left_out(self) -> tuple[str, ...]:
        """What is in no table, in lines."""
        return (*self.unreadable, *twins_told(self.twins))


def _told_apart(runs: Iterable[Run]) -> Iterator[Run]:
    """Yield runs with their settings: what other runs of the same environment and method have otherwise."""
    alike: dict[tuple[str, str], list[Run]] = {}
    for run in runs:
        alike.setdefault((run.environment, run.method), []).append(run)
    for members in alike.values():
        for run, setting in zip(members, labels_of([run.config for run in members]), strict=True):
            yield replace(run, setting=setting)


def read_runs(folder: Path, told: Told = tell_nobody) -> FoundRuns:
    """Read all finished runs in a folder and below it; of one configuration and seed, one.

    Args:
        folder: A run's or a sweep's folder, or any above them.
        told: Is told how many are read.

    Raises:
        ArtefactError: There is no run, or none that can be read.
    """
    runs: list[Run] = []
    unreadable: list[str] = []
    all_found = list(find_runs(folder))
    for number, found in enumerate(all_found, 1):
        try:
            runs.append(read_run(found.path))
        except UserError as error:
            unreadable.append(f"{found.path}: {error}")
        told(number, len(all_found))
    if not runs:
        raise none_found(folder, unreadable)
    counted_once, twins = without_twins(runs)
    return FoundRuns.in_order(counted_once, unreadable, twins)


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
    summary = folder.read_summary()
    if len(history) < summary.generations:
        raise ArtefactError(
            f"{path / HISTORY} must hold {counted(summary.generations, 'generation')}, as {SUMMARY} says; it holds "
            f"{len(history)}"
        )
    return Run(
        path=path,
        config=config,
        summary=summary,
        history=tuple(history),
        refinements=tuple(folder.read_refinements()) if config.refiner.enabled else (),
        pruned=folder.read_best_tree(),
        full=folder.read_best_tree_full(),
        archive=tuple(folder.read_archive()),
    )


def gather_runs(folder: Path, against: Path | None = None, told: Told = tell_nobody) -> FoundRuns:
    """Return the runs of `folder`, and of `against` those of methods that `folder` lacks.

    Args:
        folder: Where the runs are.
        against: Where runs of other methods are, or None.
        told: Is told how many runs of a folder are read.

    Returns:
        Runs in the order of environment, method, seed and path.

    Raises:
        ArtefactError: A folder has no run, or `against` adds none.
    """
    found = read_runs(folder, told)
    if against is None:
        return found
    environments = {run.environment for run in found.runs}
    present = {(run.environment, run.method) for run in found.runs}
    others = read_runs(against, told)
    added = [
        run
        for run in others.runs
        if run.environment in environments and (run.environment, run.method) not in present
    ]
    if not added:
        raise ArtefactError(
            f"--against must hold runs of a method that {folder} lacks in the same environment, to compare them; "
            f"those in {against} are of {', '.join(sorted({f'{r.environment} {r.method}' for r in others.runs}))}"
        )
    return FoundRuns.in_order(
        [*found.runs, *added], [*found.unreadable, *others.unreadable], [*found.twins, *others.twins]
    )


def best_run(runs: Iterable[Run]) -> Run:
    """Return the run whose champion did best in validation, of equals that with the simplest champion.

    The test is left out of the choice, so that the champion's test mean stays an honest measurement.
    """
    return max(runs, key=lambda run: (run.summary.validation_mean, -run.summary.complexity_M))
