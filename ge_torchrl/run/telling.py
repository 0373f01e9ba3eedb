"""The first line on the screen of a run, and warnings of the package there."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console

from ge_torchrl.config import Config
from ge_torchrl.environments.backend import Backend
from ge_torchrl.report.tables import counted
from ge_torchrl.run.progress import print_line


def opening_line(config: Config, backend: Backend) -> str:
    """Return what a run says first: what it is about to do."""
    return (
        f"{backend.spec.id}, seed {config.seed}: {counted(config.ge.generations, 'generation')} of "
        f"{config.ge.population_size} trees, {counted(config.evaluation.episodes, 'episode')} each, "
        f"{backend.name} route"
    )


@contextmanager
def warnings_told(told: list[str], console: Console) -> Iterator[None]:
    """Show each warning of the package once, and keep it for the summary.

    Args:
        told: Takes each warning.
        console: Where they are shown; where it is quiet, they go where warnings of Python programs go.
    """
    handler = _Teller(told, console)
    logger = logging.getLogger("ge_torchrl")
    propagates = logger.propagate
    logger.addHandler(handler)
    logger.propagate = propagates and console.quiet
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.propagate = propagates


class _Teller(logging.Handler):
    def __init__(self, told: list[str], console: Console) -> None:
        super().__init__(logging.WARNING)
        self._told, self._console = told, console

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage()
        if text not in self._told:
            self._told.append(text)
            print_line(self._console, f"warning: {text}")
