"""Trials are carried out, one after another, by one process or by several that share a folder."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing import connection, parent_process
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from ge_torchrl.config import Config
from ge_torchrl.environments.gymnasium_workers import spawning
from ge_torchrl.errors import ArtefactError, RunFaultError, UserError
from ge_torchrl.interrupts import held_back
from ge_torchrl.run.telling import warnings_told
from ge_torchrl.tuning import objective
from ge_torchrl.tuning.book import FAULT, NODES, RETURNS, UNTUNED, Book
from ge_torchrl.tuning.objective import EndedEarlyError
from ge_torchrl.tuning.task import Task, read_task

if TYPE_CHECKING:
    from optuna import Trial

Tell = Callable[[str], None]
"""Shows a line."""


def work(folder: Path, trials: int, processes: int, console: Console) -> None:
    """Carry out the trials of a study until so many are done.

    Args:
        folder: Holds the task, and the trials that are done.
        trials: Of the whole study.
        processes: So many work side by side, on one thread each; a single one takes the threads that its run asks for.
        console: Is told of each trial.

    Raises:
        KeyboardInterrupt: It was interrupted; the trial on its way is begun again next time.
        UserError: The run cannot be done without tuning, or the folder cannot be written.
        RunFaultError: A process ended before its time.
    """
    task = read_task(folder)
    if task is None:
        raise ArtefactError(f"{folder} must hold the task of a study; got a folder without one")

    def tell(line: str) -> None:
        console.print(line, markup=False, soft_wrap=True)

    if processes == 1:
        with _warnings_once(console), Book(folder, task) as book:
            _work(book, task, trials, tell)
        return
    _work_side_by_side(folder, trials, processes)


def _work_side_by_side(folder: Path, trials: int, processes: int) -> None:
    context = spawning()
    workers = [context.Process(target=_serve, args=(folder, trials)) for _ in range(processes)]
    try:
        with held_back():
            # They hear of their end from this process alone.
            for worker in workers:
                worker.start()
        for worker in workers:
            worker.join()
    finally:
        # What is broken off is begun again, so nothing is lost by an end at once.
        for worker in workers:
            if worker.is_alive():
                worker.kill()
                worker.join()
    if ended := [worker.exitcode for worker in workers if worker.exitcode]:
        raise RunFaultError(
            f"{len(ended)} of {processes} processes ended before their time (status {ended[0]}); what is done is kept, "
            "and the same command goes on"
        )


def _serve(folder: Path, trials: int) -> None:
    """Work as one of several processes."""
    _end_with_parent()
    task = read_task(folder)
    if task is None:
        raise ArtefactError(f"{folder} holds no task any more")
    console = Console(highlight=False)
    try:
        with _warnings_once(console), Book(folder, task) as book:
            _work(book, task, trials, lambda line: print(line, flush=True), is_alone=False)
    except (UserError, RunFaultError) as error:
        print(f"ge-torchrl: {error}", flush=True)
        raise SystemExit(1) from None


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is None:
        return

    def watch() -> None:
        connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _warnings_once(console: Console) -> Iterator[None]:
    """Show what runs warn of, once in all trials."""
    with warnings_told([], console):
        yield


def _work(book: Book, task: Task, trials: int, tell: Tell, *, is_alone: bool = True) -> None:
    def dead(number: int) -> None:
        tell(f"trial {number:>3}  {'':>10}  died with its process; it is begun again")

    while (trial := book.next_trial(trials, dead)) is not None:
        told = carry_out_trial(book, task, trial, is_alone=is_alone)
        tell(f"trial {trial.number:>3}  {told}")


def carry_out_trial(book: Book, task: Task, trial: Trial, *, is_alone: bool = True) -> str:
    """Carry out a trial, tell its book, and return what to say of it.

    Args:
        book: Of the study.
        task: What is asked.
        trial: Just begun.
        is_alone: Whether its runs may use all cores.
    """
    from optuna.trial import TrialState

    returns = [float(value) for value in trial.user_attrs.get(RETURNS, ())]
    is_untuned = trial.user_attrs.get(UNTUNED, False)
    try:
        _run(book, task, trial, returns, is_alone=is_alone)
    except EndedEarlyError:
        ended = book.study.tell(trial, state=TrialState.PRUNED)
        when = f"after {len(returns)} of {task.runs} runs" if returns else "on its first run"
        return f"{ended.value:>10.2f}  ended early, {when}"
    except (UserError, RunFaultError) as fault:
        trial.set_user_attr(FAULT, str(fault))
        book.study.tell(trial, state=TrialState.FAIL)
        return f"{'':>10}  failed: {fault}"
    book.study.tell(trial, _mean(returns))
    return f"{_mean(returns):>10.2f}" + ("  the settings as they stand" if is_untuned else "")


def _run(book: Book, task: Task, trial: Trial, returns: list[float], *, is_alone: bool) -> None:
    """Make the runs of a trial that are not done yet, and append what they return.

    Raises:
        EndedEarlyError: The trial is not worth the runs that are left.
    """
    nodes = list(trial.user_attrs.get(NODES, ()))
    rounded = task.rounded(trial.params)
    config = task.with_values({key: rounded[key] for key in rounded if key in trial.params})
    for run in range(len(returns), task.runs):

        def ends(value: float, run: int = run) -> bool:
            return run == 0 and book.should_end(trial, value, 1)

        seeded = replace(config if is_alone else _on_one_core(config), seed=task.seed_of(run))
        outcome = objective.outcome_of(seeded, ends)
        returns.append(outcome.value)
        nodes.append(outcome.decision_nodes)
        trial.set_user_attr(RETURNS, returns)
        trial.set_user_attr(NODES, nodes)
        if book.should_end(trial, _mean(returns), 2 * (run + 1)) and run + 1 < task.runs:
            raise EndedEarlyError


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)


def _on_one_core(config: Config) -> Config:
    env, evaluation = config.env, config.evaluation
    return replace(
        config,
        env=replace(env, workers=env.workers or 1),
        evaluation=replace(evaluation, threads=evaluation.threads or 1),
    )
