"""The trees of runs before their test: what was chosen, what the archive holds, and what tells runs apart."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.artefacts.records import Summary
from ge_torchrl.config import Config
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.errors import ArtefactError
from ge_torchrl.report.methods import method_of
from ge_torchrl.report.reading import environment_of_run, made
from ge_torchrl.report.settings import labels_of
from ge_torchrl.trees.controller import Names
from ge_torchrl.trees.tree import DecisionTree


@dataclass(frozen=True, eq=False)
class Candidates:
    """The trees of one run, before their test.

    Attributes:
        path: The run's folder.
        config: Its configuration.
        spec: Its environment.
        summary: Its summary.
        champion: Its champion.
        chosen: The champion, or the tree of the size that was asked for.
        by_size: Its archive.
        setting: What other runs of its task and method have otherwise.
    """

    path: Path
    config: Config
    spec: EnvironmentSpec
    summary: Summary
    champion: DecisionTree
    chosen: DecisionTree
    by_size: tuple[DecisionTree, ...]
    setting: str = ""

    @property
    def names(self) -> Names:
        """Its environment."""
        return self.spec.names

    @property
    def method(self) -> str:
        """By which method it searched."""
        return method_of(self.config)

    @property
    def task(self) -> tuple[tuple[str, str, tuple[str, ...], int], int, float]:
        """What has to be equal for trees to be tested together, in an order."""
        solved_at = self.spec.solved_at
        return made(self.spec.names), self.spec.max_episode_steps, np.inf if solved_at is None else solved_at

    @property
    def trees(self) -> Iterator[DecisionTree]:
        """All trees."""
        yield self.chosen
        yield from self.by_size

    def of(self, nodes: int) -> tuple[DecisionTree, ...]:
        """Return the tree of one size, if there is one."""
        return tuple(tree for tree in self.by_size if tree.num_decision_nodes == nodes)


def candidates_of(folder: RunFolder) -> Candidates:
    """Read the trees of one run.

    Raises:
        ArtefactError: A file of the run is damaged or gone.
    """
    controller = folder.read_best_tree()
    spec, champion = environment_of_run(folder, controller), controller.tree
    return Candidates(
        path=folder.path,
        config=folder.read_config(),
        spec=spec,
        summary=folder.read_summary(),
        champion=champion,
        chosen=champion,
        by_size=tuple(
            folder.read_archive_tree(record.decision_nodes).tree for record in folder.read_archive()
        ),
    )


def told_apart(runs: Iterable[Candidates]) -> Iterator[Candidates]:
    """Yield runs with their settings: nothing is averaged over different ones."""
    alike: dict[tuple[object, str], list[Candidates]] = {}
    for run in runs:
        alike.setdefault((run.task, run.method), []).append(run)
    for members in alike.values():
        for run, setting in zip(members, labels_of([run.config for run in members]), strict=True):
            yield replace(run, setting=setting)


def restricted(runs: Sequence[Candidates], nodes: int, folder: Path) -> list[Candidates]:
    """Return the runs that have a tree of one size, with that tree alone.

    Args:
        runs: Any.
        nodes: The size, in decision nodes.
        folder: Where the runs lie, for the message.

    Raises:
        ArtefactError: None has one.
    """
    having = [replace(run, chosen=run.of(nodes)[0], by_size=run.of(nodes)) for run in runs if run.of(nodes)]
    if not having:
        sizes = sorted({tree.num_decision_nodes for run in runs for tree in run.by_size})
        if not sizes:
            raise ArtefactError(
                f"the runs in {folder} must hold archives, as archive.keep above 0 makes them, to give trees with "
                f"{nodes} decision nodes; they hold none"
            )
        raise ArtefactError(
            f"the number of decision nodes must be one of {', '.join(map(str, sizes))}, because the archives in "
            f"{folder} have these; got {nodes}"
        )
    return having
