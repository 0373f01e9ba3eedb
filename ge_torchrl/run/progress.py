"""Progress of a run: a live table on a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType, TracebackType
from typing import Self

from rich.columns import Columns
from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from ge_torchrl.artefacts.records import GenerationRecord, RefinementRecord
from ge_torchrl.config import Config
from ge_torchrl.report.methods import method_of, refiner_of
from ge_torchrl.report.tables import counted
from ge_torchrl.run.costs import NOTHING, Cost
from ge_torchrl.run.notebook import NotebookConsole, NotebookLive
from ge_torchrl.run.progress_columns import aligned, cells, titles
from ge_torchrl.run.refinement_lines import number, planned_refinements, refinement_line
from ge_torchrl.run.remaining import Estimate, Pace, duration

# The table shows the generations that brought something new, and the last one.
_SHOWN_ROWS = 12
_PLAIN_LINES = 12
# Of more refinements than these only what is news gets a line.
_MOST_REFINEMENTS = 12
_REFRESH_SECONDS = 0.1
# Plain output is silent for at most so long, and for a twentieth of a long run.
_SILENCE_SECONDS, _SILENCE_SHARE = 5.0, 0.05
# Kernels that were compiled before are loaded in less than this.
_LOADED_SECONDS = 1.0


class Progress:
    """Shows a run as it goes on: its generations, its refinements, and in between that it is alive.

    Args:
        console: Where to; a terminal gets the live table, anything else plain lines.
        generations: How many are planned.
        config: The run's configuration: how trees are refined, and the limits of the run.
        search_share: The part of the run's limits at which the search has to end.
        refinement: Guess of what the refinement of a generation takes.
        compiles: Whether kernels may have to be compiled before the first step.
    """

    def __init__(
        self,
        console: Console,
        generations: int,
        config: Config,
        search_share: float = 1.0,
        refinement: Cost = NOTHING,
        *,
        compiles: bool = False,
    ) -> None:
        self._console = console
        self._generations = generations
        self._refiner = refiner_of(method_of(config))
        self._refines_often = planned_refinements(config) > _MOST_REFINEMENTS
        self._columns = titles(config)
        self._estimate = Estimate(config, search_share, refinement)
        self._left_after: dict[int, float] = {}
        self._compiles = compiles
        self._milestones: list[GenerationRecord] = []
        self._last: GenerationRecord | None = None
        self._kept: Mapping[int, float] = MappingProxyType({})
        self._printed: GenerationRecord | None = None
        self._phase = "generation 0"
        self._steps = 0
        self._left: float | None = None
        self._left_from = 0.0
        self._live: Live | NotebookLive | None = None
        self._started = self._shown_at = self._said_at = time.monotonic()

    def __enter__(self) -> Self:
        self._started = self._said_at = time.monotonic()
        if self._console.is_terminal:
            self._live = _live(self._console)
            self._live.start()
            self._refresh()
        else:
            self._print_cells(list(self._columns))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()

    def end(self) -> None:
        """Show the last generation, and leave the screen to whoever prints next; it may be called again."""
        self._phase = ""
        if self._live is not None and self._live.is_started:
            self._refresh()
            self._live.stop()
        self._print_held()

    def recall(self, records: Sequence[GenerationRecord], after_search: float = 0.0) -> None:
        """Take up the screen of a run that goes on, where it was.

        Args:
            records: All its generations so far.
            after_search: Seconds that what follows the search is expected to take.
        """
        for record in records:
            self._notice(record, after_search)
        if records:
            self._printed = self._last
            self._started -= records[-1].elapsed_seconds

    def show(
        self,
        record: GenerationRecord,
        kept: Mapping[int, float] = MappingProxyType({}),
        after_search: float = 0.0,
    ) -> None:
        """Show one more generation.

        Args:
            record: The generation.
            kept: The fitness of the best kept tree of each number of decision nodes.
            after_search: Seconds that what follows the search is expected to take.
        """
        self._kept = kept
        self._notice(record, after_search)
        if self._live is not None:
            self._refresh_where_due()
        elif record.generation % max(1, self._generations // _PLAIN_LINES) == 0 or self._is_silent():
            self._print_record(record)

    def expect(self, after_search: float, elapsed: float) -> None:
        """Take notice of how long what is left of the run will take, whatever the generations said.

        Args:
            after_search: Seconds that it is expected to take.
            elapsed: Seconds of the run so far.
        """
        self._left, self._left_from = self._estimate.within(after_search, elapsed), time.monotonic()

    def show_refinement(self, record: RefinementRecord) -> None:
        """Show a refinement above the live table, or as a line of its own; of many only new bests and failures."""
        if self._refines_often and not (record.new_best or record.outcome == "failed"):
            return
        self._print(refinement_line(record, self._refiner))

    def say(self, phase: str) -> None:
        """Say what begins now, such as "Validating"; a generation ends it."""
        self._phase = phase
        if self._live is None:
            self._print_held()
            self._print(phase)
        else:
            self._refresh()

    def note(self, line: str) -> None:
        """Say something of what came so far: above the live table, or as a line after the last generation."""
        self._print_held()
        self._print(line)

    def beat(self, steps: int) -> None:
        """Show that the run is alive.

        Args:
            steps: All environment steps of the run so far.
        """
        self._steps = steps
        if self._live is not None:
            self._refresh_where_due()
        elif self._is_silent():
            self._print(self._status())

    def _notice(self, record: GenerationRecord, after_search: float) -> None:
        self._last = record
        self._phase = f"generation {record.generation + 1}" if not self._is_last(record) else ""
        self._steps = max(self._steps, record.env_steps)
        self._left, self._left_from = self._estimate.seconds_left(record, after_search), time.monotonic()
        self._left_after[record.generation] = self._left
        if not self._milestones or _improves(record, self._milestones[-1]):
            self._milestones.append(record)

    def _is_last(self, record: GenerationRecord) -> bool:
        return record.generation + 1 >= self._generations

    def _is_silent(self) -> bool:
        silence = max(_SILENCE_SECONDS, _SILENCE_SHARE * self._seconds())
        return time.monotonic() - self._said_at >= silence

    def _seconds(self) -> float:
        return time.monotonic() - self._started

    def _status(self) -> str:
        seconds = self._seconds()
        parts = [f"{self._steps:,} steps of the environment in {duration(seconds)}"]
        if self._compiles and self._steps == 0:
            parts = [f"compiling kernels ... {duration(seconds)}"] * (seconds >= _LOADED_SECONDS)
        if self._phase:
            parts.insert(0, self._phase)
        if self._left is not None:
            # An estimate that is used up says nothing more.
            left = round(self._left - (time.monotonic() - self._left_from))
            parts += [f"about {duration(left)} left"] * (left > 0)
        return ", ".join(parts)

    def _pace(self, record: GenerationRecord) -> Pace:
        first = self._milestones[0] if self._milestones else record
        return Pace.between(first, record)

    def _print(self, line: str) -> None:
        print_line(self._console if self._live is None else self._live.console, line)
        self._said_at = time.monotonic()

    def _print_held(self) -> None:
        """Print the last generation where plain output has held it back."""
        if self._live is None and self._last is not None and self._last is not self._printed:
            self._print_record(self._last)

    def _print_record(self, record: GenerationRecord) -> None:
        self._print_cells(self._cells(record))
        self._printed = record

    def _print_cells(self, texts: list[str]) -> None:
        self._print(aligned(self._columns, texts))

    def _refresh_where_due(self) -> None:
        if time.monotonic() - self._shown_at >= _REFRESH_SECONDS:
            self._refresh()

    def _refresh(self) -> None:
        self._shown_at = time.monotonic()
        if self._live is not None:
            self._live.update(self._drawn(), refresh=True)

    def _drawn(self) -> Group:
        status = Text(self._status(), style="dim")
        if self._last is None:
            return Group(status)
        table = Table(box=None, pad_edge=False, header_style="bold")
        for title in self._columns:
            table.add_column(title, justify="right")
        earlier = [record for record in self._milestones if record is not self._last]
        for record in earlier[-_SHOWN_ROWS + 1 :]:
            table.add_row(*self._cells(record), style="dim")
        table.add_row(*self._cells(self._last))
        done = self._last.generation + 1
        below = Table.grid(padding=(0, 1))
        below.add_row(
            ProgressBar(total=self._generations, completed=done, width=40),
            Text(f"{done} of {counted(self._generations, 'generation')}", style="dim"),
        )
        return Group(table, *self._by_nodes(), below, status)

    def _by_nodes(self) -> Iterator[Table]:
        """Yield the best kept trees in one line, or two: what there is to choose from if the run ended now."""
        if self._kept:
            best = (f"{nodes}: {number(fitness)}" for nodes, fitness in self._kept.items())
            row = Table.grid(padding=(0, 2))
            row.add_row(Text("best by decision nodes"), Columns(list(best), padding=(0, 2)))
            yield row

    def _cells(self, record: GenerationRecord) -> list[str]:
        speed = self._pace(record).steps_per_second
        return cells(self._columns, record, speed, self._left_after[record.generation])


def _live(console: Console) -> Live | NotebookLive:
    if isinstance(console, NotebookConsole):
        return NotebookLive(console)
    return Live(console=console, auto_refresh=False, transient=False)


def print_line(console: Console, line: str) -> None:
    """Print a line as it is; a terminal gets it wrapped between words."""
    console.print(line, highlight=False, soft_wrap=not console.is_terminal, markup=False)


def _improves(record: GenerationRecord, on: GenerationRecord) -> bool:
    return record.best is not None and (on.best is None or record.best > on.best)
