"""A run, or a job of a sweep, is carried out: in this process, whoever started it."""

from __future__ import annotations

import traceback
from dataclasses import replace
from pathlib import Path

from ge_torchrl.artefacts.jobs import Words
from ge_torchrl.cli.output import is_output_closed, open_console, tell
from ge_torchrl.cli.statuses import FAULT, OK, OUTPUT_CLOSED
from ge_torchrl.config import Config
from ge_torchrl.errors import RunFaultError, UserError


def carry_out(config: Config, folder: Path, words: Words | None) -> int:
    """Run an experiment and return its exit status; a failure is told here, so the other jobs of a sweep go on.

    Args:
        config: Everything its run depends on.
        folder: The run's folder.
        words: What was typed for a job of a sweep; None for a run by itself.

    Raises:
        KeyboardInterrupt: Ctrl-C ended a job of a sweep, after it has told what it found.
    """
    try:
        from ge_torchrl.run.jobs import run_job

        summary = run_job(config, folder, open_console(), words)
    except Exception as error:  # noqa: BLE001 - it is told and the exit status tells.
        if is_output_closed():
            return OUTPUT_CLOSED  # Whatever else went wrong followed from it.
        if isinstance(error, UserError | RunFaultError):
            return tell(error)
        traceback.print_exc()
        return FAULT
    if summary is not None and summary.stopped_by == "interrupt" and words is not None:
        # Whoever pressed it means the sweep.
        raise KeyboardInterrupt("the job has told what it found")
    return OK


def on_threads(config: Config, n: int) -> Config:
    """Return a configuration with so many threads, unless it says how many: jobs side by side share the cores.

    Results do not depend on it.
    """
    if config.evaluation.threads != 0:
        return config
    return replace(config, evaluation=replace(config.evaluation, threads=n))
