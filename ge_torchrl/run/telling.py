"""Warnings of the package on the screen of a run."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console

from ge_torchrl.run.progress import print_line


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
