"""A run without a verdict: what it has found so far, and whether it goes on."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ge_torchrl.artefacts.checkpoints import has_checkpoint
from ge_torchrl.artefacts.folder import BEST_TREE, HISTORY, REFINEMENTS, SUMMARY, TRACEBACK, RunFolder
from ge_torchrl.artefacts.jobs import read_job
from ge_torchrl.artefacts.locks import is_locked
from ge_torchrl.artefacts.records import GenerationRecord, RefinementRecord
from ge_torchrl.config import Config
from ge_torchrl.errors import ArtefactError
from ge_torchrl.printing import message_of
from ge_torchrl.reading import is_there, read_bytes
from ge_torchrl.report.methods import done_by, method_of
from ge_torchrl.report.tables import Form, Table, counted
from ge_torchrl.trees.controller import Controller

RUNNING, FAILED, STOPPED = "running", "failed", "stopped"
"""What becomes of a run, in the words of `status`."""
RESUME = "python -m ge_torchrl resume"

# Of a traceback, with messages as long as an environment likes.
_MOST_BYTES = 16 << 20
_IN_WORDS = {RUNNING: "still running", FAILED: "broke off", STOPPED: "was interrupted"}


@dataclass(frozen=True, eq=False)
class UnfinishedRun:
    """What a run has left so far; it is not tested.

    Attributes:
        path: Its folder.
        config: Its configuration.
        state: "running", "failed" or "stopped".
        fault: What broke it off, in a line; empty where nothing is written of that.
        history: Its generations, at least one. Its trees may be some generations older.
        refinements: Its refinements.
        best: The best tree so far.
        archive: The best tree of each size, from small to large; none where it keeps no archive.
    """

    path: Path
    config: Config
    state: str
    fault: str
    history: tuple[GenerationRecord, ...]
    refinements: tuple[RefinementRecord, ...]
    best: Controller
    archive: tuple[Controller, ...]

    @property
    def environment(self) -> str:
        """As of `Run`."""
        return self.best.names.environment

    @property
    def done(self) -> str:
        """By which method it has searched so far."""
        return done_by(method_of(self.config), self.history[-1].refined, self.history[-1].polished)

    @property
    def train_fitness(self) -> float | None:
        """The best tree's fitness on its training episodes; it lies in the tree's own file, so it is of this tree."""
        return _number(self.best, "train_fitness")

    @property
    def so_far(self) -> str:
        """How far it is."""
        generations = f"{len(self.history)} of {counted(self.config.ge.generations, 'generation')}"
        return f"{generations} in {self.history[-1].elapsed_seconds:.0f} s"

    @property
    def can_go_on(self) -> bool:
        """Whether `resume` takes it: no process is at it, and there is a checkpoint."""
        return self.state != RUNNING and has_checkpoint(self.path)

    @property
    def in_words(self) -> str:
        """Whether it goes on, and that nothing has tested it."""
        fault = f" ({self.fault})" if self.fault else ""
        return f"{_IN_WORDS[self.state]}{fault}, not tested"


def is_unfinished(path: Path) -> bool:
    """Tell whether a folder is that of a run without a verdict."""
    return is_there(path / HISTORY) and not is_there(path / SUMMARY)


def state_of(path: Path) -> tuple[str, str]:
    """Return what has become of a run without a verdict, and what broke it off, in a line."""
    if is_locked(path):
        return RUNNING, ""
    if is_there(path / TRACEBACK):
        return FAILED, _last_line(path / TRACEBACK)
    try:
        job = read_job(path)
    except ArtefactError:
        job = None
    return (FAILED, job.error) if job and job.error else (STOPPED, "")


def read_unfinished(path: Path) -> UnfinishedRun:
    """Read what a run has left so far, while it may go on.

    Raises:
        ArtefactError: There is no generation or no tree yet, or a file is unreadable.
        ConfigError: The configuration is none.
        InvalidTreeError: A tree's file holds no valid tree.
    """
    folder = RunFolder(path)
    state, fault = state_of(path)
    config, history = folder.read_config(), folder.read_history()
    if not history or not is_there(path / BEST_TREE):
        raise ArtefactError(
            f"{path} must hold a generation and a tree, to be shown; the run there {_IN_WORDS[state]} and has none yet"
        )
    return UnfinishedRun(
        path=path,
        config=config,
        state=state,
        fault=fault,
        history=tuple(history),
        refinements=tuple(folder.read_refinements()) if is_there(path / REFINEMENTS) else (),
        best=folder.read_best_tree(),
        archive=tuple(_archive(folder)),
    )


def archive_mean(controller: Controller) -> float | None:
    """Return a kept tree's mean return on the archive's episodes, which lies in its own file."""
    return _number(controller, "archive_mean")


def unfinished_text(run: UnfinishedRun, form: Form) -> str:
    """Return what there is to say of a run without a verdict, with the best tree of each size.

    Args:
        run: The run.
        form: Where it is read.
    """
    mark = "**" if form == "markdown" else ""
    fitness = (
        "" if run.train_fitness is None else f", fitness {run.train_fitness:.2f} on its training episodes"
    )
    nodes = counted(run.best.tree.num_decision_nodes, "decision node")
    lines = [
        f"{mark}{run.environment} {run.done}, seed {run.config.seed}{mark}: {run.in_words}",
        f"{run.so_far}; the best tree so far has {nodes}{fitness}",
    ]
    if run.can_go_on:
        lines.append(f"to go on: {RESUME} {shlex.quote(str(run.path))}")
    rows = [
        (str(one.tree.num_decision_nodes), "" if mean is None else f"{mean:.2f}")
        for one, mean in ((one, archive_mean(one)) for one in run.archive)
    ]
    table = Table.of(("decision nodes", "mean return on the archive's episodes, untested"), rows)
    return "\n\n".join(["\n".join(lines), *([table.told(form)] if rows else [])])


def _archive(folder: RunFolder) -> Iterator[Controller]:
    for record in folder.read_archive():
        try:
            yield folder.read_archive_tree(record.decision_nodes)
        except ArtefactError:
            continue  # The run has found a better archive meanwhile, without a tree of this size.


def _number(controller: Controller, key: str) -> float | None:
    value = controller.provenance.get(key)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _last_line(trace: Path) -> str:
    try:
        lines = read_bytes(trace, _MOST_BYTES).decode("utf-8", errors="replace").strip().splitlines()
    except ArtefactError as error:
        return str(error)
    return message_of(lines[-1]) if lines else "no reason is written down"
