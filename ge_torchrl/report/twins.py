"""Runs of one configuration and seed are one run, done twice: one of them counts."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple, Protocol, TypeVar

from ge_torchrl.artefacts.records import Summary
from ge_torchrl.config import Config
from ge_torchrl.report.settings import compared
from ge_torchrl.trees.controller import Names

# Law 6: they change nothing that a run finds.
_CHANGE_NOTHING = frozenset({"evaluation.threads", "env.workers"})
_MOST_NAMED = 3


class Found(Protocol):
    """A finished run, whoever reads it."""

    @property
    def path(self) -> Path:
        """Its folder."""

    @property
    def config(self) -> Config:
        """Its configuration."""

    @property
    def summary(self) -> Summary:
        """What it found."""

    @property
    def names(self) -> Names:
        """Its environment."""


_Run = TypeVar("_Run", bound=Found)


class Twin(NamedTuple):
    """A run that is not counted.

    Attributes:
        path: Its folder.
        of: The folder of the run with its configuration and seed, which counts.
    """

    path: Path
    of: Path


def without_twins(runs: Iterable[_Run]) -> tuple[list[_Run], list[Twin]]:
    """Return the runs of which each configuration and seed has one, and those that are left out.

    The one that counts came to its end, and lies highest: what is run again within the folder of a run is the twin. It
    is never chosen by what it found.

    Args:
        runs: Of any environments and methods. Runs of other versions, or of a plant whose file was changed, are no
            twins.
    """

    def order(run: _Run) -> tuple[bool, int, Path]:
        return run.summary.stopped_by == "interrupt", len(run.path.parts), run.path

    every = sorted(runs, key=order)
    first: dict[Hashable, _Run] = {}
    twins = []
    for run, key in zip(every, _keys(every), strict=True):
        counted = first.setdefault(key, run)
        if counted is not run:
            twins.append(Twin(run.path, counted.path))
    return list(first.values()), sorted(twins)


def twins_told(twins: Sequence[Twin]) -> list[str]:
    """Return one line that tells of all twins; none where there are none."""
    if not twins:
        return []
    named = [f"{twin.path} is {twin.of} again" for twin in twins[:_MOST_NAMED]]
    more = f"; and {len(twins) - _MOST_NAMED} more" if len(twins) > _MOST_NAMED else ""
    runs = "1 run has" if len(twins) == 1 else f"{len(twins)} runs have"
    return [f"{runs} the configuration and seed of another, which is counted once: {'; '.join(named)}{more}"]


def _keys(runs: Sequence[Found]) -> list[Hashable]:
    """Return for each run what its twins have too."""
    settings = [
        tuple(item for item in values.items() if item[0] not in _CHANGE_NOTHING)
        for values in compared([run.config for run in runs])
    ]
    return [
        (values, run.summary.seed, run.summary.version, run.names.environment, run.names.source)
        for values, run in zip(settings, runs, strict=True)
    ]
