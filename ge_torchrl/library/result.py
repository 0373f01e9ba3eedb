"""What a run found, as one object: from memory, or from the folder of a run."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ge_torchrl.artefacts.folder import SUMMARY, RunFolder
from ge_torchrl.artefacts.looking import check_run
from ge_torchrl.artefacts.memory import Artefacts
from ge_torchrl.artefacts.records import ArchiveRecord, GenerationRecord, RefinementRecord, Summary
from ge_torchrl.config import Config
from ge_torchrl.library.controller import Controller
from ge_torchrl.library.controllers import Controllers
from ge_torchrl.report.evaluated import verdict
from ge_torchrl.report.methods import done_by, method_of
from ge_torchrl.report.sizes import SizeRow, by_size, sizes_table, trees_of_archive
from ge_torchrl.report.statistics import FEW, Interval, mean_interval
from ge_torchrl.report.tables import counted
from ge_torchrl.run.closing import drawn


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """What a run found.

    Attributes:
        champion: The controller that validation chose; `summary` says what a test said of it.
        controllers: The best controller of each number of decision nodes: `controllers[3]`.
        summary: What was found and what it took: `summary.test_mean`, `summary.solved`, `summary.wall_seconds` ...
        sizes: What validation and test said of each of `controllers`, from small to large.
        history: A record for each generation.
        refinements: A record for each tree that was refined.
        config: The whole configuration, with what the run decided by the speed of the environment.
    """

    champion: Controller
    controllers: Controllers
    summary: Summary
    sizes: tuple[ArchiveRecord, ...]
    history: tuple[GenerationRecord, ...]
    refinements: tuple[RefinementRecord, ...]
    config: Config

    @classmethod
    def of(cls, artefacts: Artefacts) -> Result:
        """Return what a finished run left.

        Raises:
            ArtefactError: The run did not come to its end, or a file is missing.
        """
        summary, sizes, config = artefacts.read_summary(), artefacts.read_archive(), artefacts.read_config()
        refines = config.refiner.enabled
        return cls(
            champion=Controller.of(artefacts.read_best_tree()),
            controllers=controllers_of(artefacts),
            summary=summary,
            sizes=tuple(sizes),
            history=tuple(artefacts.read_history()),
            refinements=tuple(artefacts.read_refinements()) if refines else (),
            config=config,
        )

    @property
    def test_interval(self) -> Interval:
        """The 95 % interval of the champion's mean return in the test."""
        summary = self.summary
        return mean_interval(summary.test_mean, summary.test_std, summary.test_episodes)

    def __repr__(self) -> str:
        parts = [self._told(), drawn(self.champion), *(sizes_table(rows).aligned() for rows in self._rows())]
        return "\n\n".join([*parts, *self._lines()])

    def _repr_markdown_(self) -> str:
        tree = f"```text\n{drawn(self.champion)}\n```"
        tables = (sizes_table(rows).markdown() for rows in self._rows())
        return "\n\n".join([f"**{self._told()}**", tree, *tables, *self._lines()])

    def _told(self) -> str:
        summary = self.summary
        method = done_by(method_of(self.config), summary.refined, summary.polished)
        return (
            f"{self.champion.names.environment}, seed {summary.seed}, {method}: "
            f"{verdict(summary.solved, summary.solved_at)}"
        )

    def _rows(self) -> Iterator[list[SizeRow]]:
        summary = self.summary
        if rows := by_size(trees_of_archive(self.sizes, summary.seed, summary.decision_nodes)):
            yield rows

    def _lines(self) -> Iterator[str]:
        summary, (low, high) = self.summary, self.test_interval
        interval = f" (95 % interval {low:.2f} to {high:.2f})" * (summary.test_episodes >= FEW)
        yield (
            f"test mean {summary.test_mean:.2f}{interval} on "
            f"{counted(summary.test_episodes, 'unseen episode')}, "
            f"{counted(summary.decision_nodes, 'decision node')}, M = {summary.complexity_M:g}"
        )
        stopped = "" if summary.stopped_by == "generations" else f", stopped by {summary.stopped_by}"
        yield (
            f"{counted(summary.generations, 'generation')}{stopped}, {summary.env_steps_total:,} steps of the "
            f"environment, {summary.wall_seconds:.1f} s"
        )
        yield from (f"warning: {warning}" for warning in summary.warnings)


def controllers_of(artefacts: Artefacts) -> Controllers:
    """Return the best controller of each number of decision nodes that a run has kept.

    Raises:
        ArtefactError: A file is missing.
    """
    sizes = [record.decision_nodes for record in artefacts.read_archive()]
    return Controllers({size: Controller.of(artefacts.read_archive_tree(size)) for size in sizes})


def load_run(folder: str | os.PathLike[str]) -> Result:
    """Load what a run left in its folder: that of `out=`, or of the command line.

    Args:
        folder: The run's folder.

    Raises:
        ArtefactError: There is no finished run, or one of its files cannot be read.
    """
    path = Path(folder)
    check_run(path, SUMMARY)
    return Result.of(RunFolder(path))
