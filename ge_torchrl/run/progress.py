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

from ge_torchrl.config import Config
from ge_torchrl.records import GenerationRecord, RefinementRecord
from ge_torchrl.report.methods import method_of, refiner_of

# The table shows the generations that brought something new, and the last one.
_SHOWN_ROWS = 12
_PLAIN_LINES = 12
# Of more refinements than these only what is news gets a line.
_MOST_REFINEMENTS = 12
_REFRESH_SECONDS = 0.1


class Progress:
    """Shows generations as they come.

    Args:
        console: Where to; a terminal gets the live table, anything else plain lines.
        generations: How many are planned.
        config: The run's configuration, which tells how trees are refined; None tells nothing of it.
    """

    def __init__(self, console: Console, generations: int, config: Config | None = None) -> None:
        self._console = console
        self._generations = generations
        self._refiner = "refinement" if config is None else refiner_of(method_of(config))
        self._refines_often = config is not None and _planned_refinements(config) > _MOST_REFINEMENTS
        self._columns = _COLUMNS + (_EXPLORED,) * (config is not None and _explores(config))
        self._milestones: list[GenerationRecord] = []
        self._last: GenerationRecord | None = None
        self._live: Live | None = None
        self._shown_at = -1.0

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._live = Live(console=self._console, auto_refresh=False, transient=False)
            self._live.start()
        else:
            self._print_cells(self._columns)
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

    def show_refinement(self, record: RefinementRecord) -> None:
        """Show a refinement above the live table, or as a line of its own; of many only new bests and failures."""
        if self._refines_often and not (record.new_best or record.outcome == "failed"):
            return
        console = self._console if self._live is None else self._live.console
        console.print(_refinement_line(record, self._refiner), highlight=False, soft_wrap=True)

    def _print_line(self, record: GenerationRecord) -> None:
        self._print_cells(self._cells(record))
        self._printed = record

    def _print_cells(self, cells: tuple[str, ...]) -> None:
        widths = (max(len(title), _LEAST_WIDTH) for title in self._columns)
        line = "  ".join(cell.rjust(width) for cell, width in zip(cells, widths, strict=True))
        self._console.print(line, highlight=False, soft_wrap=True)

    def _refresh(self) -> None:
        self._shown_at = time.monotonic()
        if self._live is not None and self._last is not None:
            self._live.update(self._table(self._last), refresh=True)

    def _table(self, last: GenerationRecord) -> Group:
        table = Table(box=None, pad_edge=False, header_style="bold")
        for title in self._columns:
            table.add_column(title, justify="right")
        earlier = [record for record in self._milestones if record is not last]
        for record in earlier[-_SHOWN_ROWS + 1 :]:
            table.add_row(*self._cells(record), style="dim")
        table.add_row(*self._cells(last))
        done = last.generation + 1
        bar = ProgressBar(total=self._generations, completed=done, width=40)
        below = Table.grid(padding=(0, 1))
        below.add_row(bar, Text(f"{done} of {self._generations} generations", style="dim"))
        return Group(table, below)

    def _cells(self, record: GenerationRecord) -> tuple[str, ...]:
        elapsed = max(record.elapsed_seconds, 1e-9)
        left = elapsed / (record.generation + 1) * (self._generations - record.generation - 1)
        cells = (
            str(record.generation),
            _number(_best(record)),
            _number(record.median_fitness),
            "-" if record.best_decision_nodes is None else str(record.best_decision_nodes),
            _rate(record.env_steps / elapsed),
            _duration(left),
            f"{record.explored:,}",
        )
        return cells[: len(self._columns)]


_COLUMNS = ("generation", "best", "median", "splits of best", "env steps/s", "time left")
# Trees refined so far in exploring from the hall of fame.
_EXPLORED = "explored"
_LEAST_WIDTH = 8


def _planned_refinements(config: Config) -> float:
    """Return how many trees of the population will be refined, as expected."""
    refiner = config.refiner
    generations = sum(map(refiner.schedule.applies_to, range(config.ge.generations)))
    return generations * refiner.candidates * refiner.probability if refiner.enabled else 0


def _explores(config: Config) -> bool:
    """Tell whether trees will be refined in exploring from the hall of fame."""
    hall = config.hall_of_fame
    return hall.neighbours + hall.revisits > 0


def _best(record: GenerationRecord) -> float | None:
    """The best of the population and of the refined trees."""
    return max(
        (best for best in (record.best_fitness, record.best_refined) if best is not None), default=None
    )


def _improves(record: GenerationRecord, on: GenerationRecord) -> bool:
    ours, theirs = _best(record), _best(on)
    return ours is not None and (theirs is None or ours > theirs)


def _refinement_line(record: RefinementRecord, refiner: str) -> str:
    front = f"generation {record.generation}  {refiner}:"
    if record.outcome == "skipped":
        return f"{front} skipped, no candidate in {record.redraws} redraws"
    nodes = "1 node" if record.decision_nodes == 1 else f"{record.decision_nodes} nodes"
    what = f"{front} {record.chosen} tree of {nodes}"
    if record.outcome == "failed":
        return f"{what} kept as it was, {record.failure}, {record.refine_seconds:.1f} s"
    verdict = "new best" if record.new_best else record.outcome.replace("_", " ")
    return (
        f"{what}, {_number(record.return_before)} -> {_number(record.return_after)} on unseen episodes, "
        f"{verdict}, {record.refine_seconds:.1f} s"
    )


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
