"""A study from its task to its page and its preset."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console

from ge_torchrl.artefacts.texts import told_of
from ge_torchrl.config import Config
from ge_torchrl.report.tables import counted
from ge_torchrl.tuning.book import INSTALL, forget_failed
from ge_torchrl.tuning.findings import COMPLETE, ENDED, Findings, findings_of
from ge_torchrl.tuning.page import UNSEEN, verdict, write_page
from ge_torchrl.tuning.preset import (
    comparing_commands,
    name_of_study,
    preset_command,
    preset_path,
    write_preset,
)
from ge_torchrl.tuning.space import check_keys, shown
from ge_torchrl.tuning.task import Task, check_same, prepare, read_task, write_task
from ge_torchrl.tuning.work import Tell, work

__all__ = ["INSTALL", "Asked", "begin", "carry_out", "check_keys", "name_of_study"]


@dataclass(frozen=True)
class Asked:
    """What was typed.

    Attributes:
        config: The run, as it was composed.
        words: Its words.
        config_dir: The folder of choices beside them; None for none.
        space: What is to be tuned; see `space_of`.
        runs: Runs of each trial.
        trials: Of the whole study.
        processes: That work side by side.
    """

    config: Config
    words: tuple[str, ...]
    config_dir: str | None
    space: tuple[str, ...]
    runs: int
    trials: int
    processes: int


def begin(folder: Path, asked: Asked, console: Console) -> Task:
    """Return the task of a study, new or gone on with, and leave it in its folder.

    Raises:
        UserError: The run cannot be done, the space is none, or the folder holds another study.
    """
    earlier = read_task(folder)
    if earlier is not None and forget_failed(folder):
        earlier = None
    pinned = {word.partition("=")[0].lstrip("+~") for word in asked.words}
    task = prepare(asked.config, asked.space, pinned, asked.runs, earlier, console)
    task = replace(task, words=asked.words, config_dir=asked.config_dir)
    if earlier is not None:
        check_same(folder, task, earlier)
        return earlier
    with told_of(folder):
        folder.mkdir(parents=True, exist_ok=True)
    write_task(folder, task)
    return task


def carry_out(folder: Path, task: Task, asked: Asked, name: str, console: Console) -> Findings:
    """Carry out the trials of a study, and leave its page and its preset, also where it is interrupted.

    Args:
        folder: Holds the task.
        task: What is asked.
        asked: How many trials, and by how many processes.
        name: What the study is called.
        console: Is told of everything.

    Raises:
        KeyboardInterrupt: It was interrupted, and has told what it found.
        UserError: The run cannot be done without tuning, or the folder cannot be written.
    """

    def tell(line: str) -> None:
        console.print(line, markup=False, soft_wrap=True)

    tell(
        f"{task.config.env.id}: {counted(asked.trials, 'trial')} over {counted(len(task.space), 'setting')}, up to "
        f"{counted(task.runs, 'run')} each, of at most {task.limit}; in {folder}"
    )
    try:
        work(folder, asked.trials, asked.processes, console)
    except KeyboardInterrupt:
        tell("interrupted; the same command goes on")
        _tell(folder, task, name, tell)
        raise KeyboardInterrupt("the study has told what it found") from None
    return _tell(folder, task, name, tell)


def _tell(folder: Path, task: Task, name: str, tell: Tell) -> Findings:
    findings = findings_of(folder, task)
    page = write_page(folder, findings, name)
    ended = f"{findings.count(COMPLETE)} with all runs, {findings.count(ENDED)} ended early"
    tell(f"\n{counted(len(findings.tried), 'trial')}, {ended}. {verdict(findings)}".replace("\u2212", "-"))
    if findings.is_better and findings.best is not None and findings.untuned is not None:
        best = findings.best
        for one in task.space:
            if shown(best.values[one.key]) != shown(one.untuned):
                tell(f"  {one.key}: {shown(one.untuned)} -> {shown(best.values[one.key])}")
        path = preset_path(folder, task, name)
        where = f"Trial {best.number} of {len(findings.tried)} by tune {' '.join(task.words)}"
        what = f"{best.value:.2f} over {counted(task.runs, 'run')} of at most {task.limit}"
        told = (f"{where.rstrip()}:", f"{what}, and {findings.untuned.value:.2f} without tuning.")
        write_preset(path, task, best.values, told)
        tell(f"\nthe best settings are in {path}; run them with\n  {preset_command(folder, task, name)}")
        tuned, untuned = comparing_commands(folder, task, name, UNSEEN)
        tell(f"and compare them on seeds that no trial has seen\n  {tuned}\n  {untuned}")
    tell(f"page: {page}")
    return findings
