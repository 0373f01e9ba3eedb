"""A run from configuration to verdict: describe, search, choose, prune, test, write, tell; and one that goes on."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from rich.console import Console

from ge_torchrl.artefacts.checkpoints import has_checkpoints
from ge_torchrl.artefacts.folder import CONFIG, PAGE, SUMMARY, RunFolder
from ge_torchrl.artefacts.locks import LOCK, Lock
from ge_torchrl.artefacts.looking import check_run
from ge_torchrl.artefacts.memory import Artefacts
from ge_torchrl.artefacts.records import Summary
from ge_torchrl.config import Config
from ge_torchrl.environments.choose import open_backend
from ge_torchrl.environments.trust import check_trusted
from ge_torchrl.run.closing import closing_text
from ge_torchrl.run.episodes import write_page_of_run
from ge_torchrl.run.finished import Finished, JudgingSeeds, Observer
from ge_torchrl.run.plan import plan
from ge_torchrl.run.running import Run
from ge_torchrl.run.warming import compile_kernels, is_first_of_its_kind
from ge_torchrl.search.fitness import test_seeds


def run(config: Config, output_dir: Path, console: Console | None = None) -> Summary:
    """Run an experiment and leave its artefacts in a folder.

    Args:
        config: Everything the run depends on.
        output_dir: The run folder, made if need be.
        console: Where progress goes; standard output if not given.

    Returns:
        The summary, as it is in the folder.

    Raises:
        UserError: The configuration cannot be run, or the environment failed on the way.
        RunFaultError: Something else failed; the best tree so far is in the folder.
    """
    return _to_the_end(config, lambda decided: RunFolder.create(output_dir, decided), output_dir, console)


def resume(path: Path, console: Console | None = None) -> Summary | None:
    """Go on with a run that was killed or interrupted, or that broke off; it ends as if it had been left alone.

    Args:
        path: The run's folder.
        console: Where progress goes; standard output if not given.

    Returns:
        The summary, as it is in the folder; None where the run has come to its end before.

    Raises:
        UserError: There is nothing to go on from, another process runs it, or the environment failed.
        RunFaultError: Something else failed; the best tree so far is in the folder.
    """
    console = console or Console(highlight=False)
    if is_finished(path):
        if (path / LOCK).exists():
            # Of a process that was killed on its last steps; one that lives is told of.
            Lock(path).release()
        if not (path / PAGE).exists():
            write_page_of_run(path, console)
        return None
    if not has_checkpoints(path):
        check_run(path, CONFIG)
    folder = RunFolder.reopen(path)
    try:
        config = folder.read_config()
        check_trusted(config.env.id, config.env.wrappers, path)
        return _to_the_end(config, lambda _: folder, path, console)
    finally:
        folder.release()


def is_finished(path: Path) -> bool:
    """Tell whether the run in a folder has come to its end: one that was interrupted can go on."""
    return (path / SUMMARY).exists() and not has_checkpoints(path)


def _to_the_end(
    config: Config, keep: Callable[[Config], RunFolder], path: Path, console: Console | None
) -> Summary:
    console = console or Console(highlight=False)
    finished = carry_out(config, keep, console)
    write_page_of_run(path, console)
    text = closing_text(
        finished.summary,
        finished.champion,
        path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path,
        finished.archive,
        finished.refiner,
        improved=finished.improved,
        once_more=finished.once_more,
        width=console.width if console.is_terminal else None,
    )
    console.print(f"\n{text}", soft_wrap=True)
    return finished.summary


def carry_out(
    config: Config,
    keep: Callable[[Config], Artefacts],
    console: Console,
    observer: Observer = lambda _record, _state, _names: False,
    judging_seeds: JudgingSeeds = test_seeds,
) -> Finished:
    """Run an experiment, wherever it leaves its artefacts and whoever looks on.

    Args:
        config: Everything the run depends on.
        keep: Opens what keeps the artefacts of a run of this configuration, its budgets resolved.
        console: Where progress goes.
        observer: Is told of each generation.
        judging_seeds: Gives the episodes that judge what was found, in place of the test's.

    Raises:
        UserError: The configuration cannot be run, or the environment failed on the way.
        RunFaultError: Something else failed; the best tree so far is kept.
    """
    planned = plan(config)
    # What was to be found out of the environment beforehand is a part of the run.
    started = time.perf_counter() - planned.seconds
    is_first = is_first_of_its_kind(planned)
    if is_first:
        console.print("Compiling the kernels for this machine, once; this takes some seconds ...")
    with ExitStack() as opened:
        backend = open_backend(planned.spec, config.env.route, config.evaluation.threads, config.env.workers)
        opened.callback(backend.close)
        if is_first:
            # That happens once, and is no part of what a run may take.
            compile_kernels(planned, backend.name)
            started = time.perf_counter() - planned.seconds

        def kept(decided: Config) -> Artefacts:
            artefacts = keep(decided)
            opened.callback(artefacts.release)
            return artefacts

        return Run(planned, backend, kept, console, observer, started, judging_seeds).to_the_end()
