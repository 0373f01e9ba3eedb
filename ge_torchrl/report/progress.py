"""Progress of a run: a live table on a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from types import TracebackType
from typing import Self

from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from ge_torchrl.artefacts import GenerationRecord

# The table shows the generations that brought something new, and the last one.
_SHOWN_ROWS = 12
_PLAIN_LINES = 12
_REFRESH_SECONDS = 0.1


class Progress:
    """Shows generations as they come.

    Args:
        console: Where to; a terminal gets the live table, anything else plain lines.
        generations: How many are planned.
    """

    def __init__(self, console: Console, generations: int) -> None:
        self._console = console
        self._generations = generations
        self._milestones: list[GenerationRecord] = []
        self._last: GenerationRecord | None = None
        self._live: Live | None = None
        self._shown_at = -1.0

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._live = Live(console=self._console, auto_refresh=False, transient=False)
            self._live.start()
        else:
            self._console.print(_plain_header(), highlight=False)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._refresh()
            self._live.stop()
        elif self._last is not None and self._last is not self._printed:
            self._print_line(self._last)

    _printed: GenerationRecord | None = None

    def show(self, record: GenerationRecord) -> None:
        """Show one more generation."""
        self._last = record
        if not self._milestones or _improves(record, self._milestones[-1]):
            self._milestones.append(record)
        if self._live is None:
            if record.generation % max(1, self._generations // _PLAIN_LINES) == 0:
                self._print_line(record)
        elif time.monotonic() - self._shown_at >= _REFRESH_SECONDS:
            self._refresh()

    def _print_line(self, record: GenerationRecord) -> None:
        cells = (cell.rjust(width) for cell, width in zip(self._cells(record), _WIDTHS, strict=True))
        self._console.print("  ".join(cells), highlight=False)
        self._printed = record

    def _refresh(self) -> None:
        self._shown_at = time.monotonic()
        if self._live is not None and self._last is not None:
            self._live.update(self._table(self._last), refresh=True)

    def _table(self, last: GenerationRecord) -> Group:
        table = Table(box=None, pad_edge=False, header_style="bold")
        for title in _COLUMNS:
            table.add_column(title, justify="right")
        earlier = [record for record in self._milestones if record is not last]
        for record in earlier[-_SHOWN_ROWS + 1 :]:
            table.add_row(*self._cells(record), style="dim")
        table.add_row(*self._cells(last))
        done = last.generation + 1
        bar = ProgressBar(total=self._generations, completed=done, width=40)
        return Group(table, bar, Text(f"{done} of {self._generations} generations", style="dim"))

    def _cells(self, record: GenerationRecord) -> tuple[str, ...]:
        elapsed = max(record.elapsed_seconds, 1e-9)
        left = elapsed / (record.generation + 1) * (self._generations - record.generation - 1)
        return (
            str(record.generation),
            _number(record.best_fitness),
            _number(record.median_fitness),
            "-" if record.best_decision_nodes is None else str(record.best_decision_nodes),
            _rate(record.env_steps / elapsed),
            _duration(left),
        )


_COLUMNS = ("generation", "best", "median", "splits of best", "env steps/s", "time left")
_WIDTHS = tuple(max(len(title), 8) for title in _COLUMNS)


def _plain_header() -> str:
    return "  ".join(title.rjust(width) for title, width in zip(_COLUMNS, _WIDTHS, strict=True))


def _improves(record: GenerationRecord, on: GenerationRecord) -> bool:
    if record.best_fitness is None:
        return False
    return on.best_fitness is None or record.best_fitness > on.best_fitness


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _rate(per_second: float) -> str:
    for unit, size in (("M", 1e6), ("k", 1e3)):
        if per_second >= size:
            return f"{per_second / size:.1f} {unit}"
    return f"{per_second:.0f}"


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours}:{minutes:02}:{rest:02}"
    return f"{minutes}:{rest:02}"
