"""What runs of one method show, in words and tables that are computed from them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np

from ge_torchrl.report.methods import refiner_of
from ge_torchrl.report.runs import Run
from ge_torchrl.report.statistics import FEW, Interval, spread_of, wilson_interval
from ge_torchrl.report.tables import Form, RunRow, Table, counted, runs_table
from ge_torchrl.report.thesis.beside import published_beside, published_columns, published_in_short, source_of


def by_method(runs: Sequence[Run]) -> Iterator[list[Run]]:
    """Yield the runs of each environment, method and setting.

    Args:
        runs: In this order.
    """
    for _, members in groupby(runs, key=lambda run: (run.environment, run.label)):
        yield list(members)


def runs_tables(runs: Sequence[Run], form: Form = "markdown") -> str:
    """Return for each environment, method and setting a title and its table of runs.

    Args:
        runs: In the order of environment, method and setting.
        form: Where they are read.
    """
    mark = "**" if form == "markdown" else ""
    return "\n\n".join(f"{_title(members, mark)}\n\n{table_of(members, form)}" for members in by_method(runs))


def table_of(runs: Sequence[Run], form: Form = "markdown") -> str:
    """Return a table, a row a run, with the thesis' numbers at its right where they are of this method.

    Args:
        runs: Runs of one environment, method and setting.
        form: Where it is read.
    """
    table = runs_table([RunRow.of(run.summary) for run in runs])
    if published := published_beside(runs[0].method, runs[0].environment):
        table = table.beside(published_columns(published, [run.seed for run in runs]))
    return table.told(form)


def overview_table(runs: Sequence[Run]) -> str:
    """Return a Markdown table, a row an environment, method and setting, with what the thesis found at its right.

    Args:
        runs: In the order of environment, method and setting.
    """
    groups = list(by_method(runs))
    table = Table.of(
        ("method", "runs", "solved", "mean test return", "mean M"),
        (
            (
                f"{members[0].environment} {members[0].label}".replace("|", r"\|"),
                str(len(members)),
                solved_text(members),
                f"{np.mean([run.summary.test_mean for run in members]):.2f}",
                f"{np.mean([run.summary.complexity_M for run in members]):.1f}",
            )
            for members in groups
        ),
    )
    published = [published_beside(members[0].method, members[0].environment) for members in groups]
    return table.beside(published_in_short(published)).without_empty_columns().markdown()


def method_text(runs: Sequence[Run], rng: np.random.Generator) -> str:
    """Return the table of runs, and what it shows.

    Args:
        runs: Runs of one environment, method and setting.
        rng: Draws the resamples of intervals.
    """
    published = published_beside(runs[0].method, runs[0].environment)
    trained = [run.summary.train_fitness for run in runs]
    tested = [run.summary.test_mean for run in runs]
    lines = []
    if runs[0].summary.solved_at is not None:
        lines.append(f"* Solved: {solved_text(runs)}.")
    lines += [
        f"* Mean training fitness: {_mean(trained, rng)}.",
        f"* Mean test return: {_mean(tested, rng)}. The training fitness is {_gap(trained, tested)}.",
        f"* Mean complexity M: {_mean([run.summary.complexity_M for run in runs], rng)}.",
    ]
    if len({run.seed for run in runs}) < len(runs):
        lines.append("* Some seeds stand more than once; what pairs runs by seed takes the first of them.")
    lines += _warnings(runs)
    source = "" if published is None else f"\n\n{source_of(published)}"
    return f"{table_of(runs)}{source}\n\n" + "\n".join(lines)


def solved_text(runs: Sequence[Run]) -> str:
    """Return how many runs solved their task, with Wilson's interval of the rate; nothing without a threshold."""
    if runs[0].summary.solved_at is None:
        return ""
    solved, n = sum(bool(run.summary.solved) for run in runs), len(runs)
    low, high = wilson_interval(solved, n)
    return f"{solved} of {n} ({low:.0%} to {high:.0%})"


def interval_text(value: float, interval: Interval, n: int) -> str:
    """Return a number with its interval; of few runs with what they span, and of one alone."""
    if n == 1:
        return f"{value:.2f}"
    return f"{value:.2f} ({'range ' * (n < FEW)}{interval.low:.2f} to {interval.high:.2f})"


def _title(runs: Sequence[Run], mark: str) -> str:
    first = runs[0].summary
    threshold = "" if first.solved_at is None else f", solved from {first.solved_at:g}"
    refiner = refiner_of(runs[0].method)
    idle = f"; {refiner} refined no tree" * bool(refiner and not any(run.summary.refined for run in runs))
    return (
        f"{mark}{runs[0].environment} {runs[0].label}{mark} "
        f"({first.test_episodes} test episodes{threshold}{idle})"
    )


def _warnings(runs: Sequence[Run]) -> list[str]:
    """Return what the runs warned of, each once."""
    told: dict[str, list[int]] = {}
    for run in runs:
        for warning in run.summary.warnings:
            told.setdefault(warning, []).append(run.seed)
    return [
        f"* Warning of {counted(len(seeds), 'run')} (seed {seeds[0]} first): {warning}"
        for warning, seeds in told.items()
    ]


def _mean(values: Sequence[float], rng: np.random.Generator) -> str:
    return interval_text(float(np.mean(values)), spread_of(values, rng), len(values))


def _gap(trained: Sequence[float], tested: Sequence[float]) -> str:
    gap = float(np.mean(trained) - np.mean(tested))
    return f"{abs(gap):.2f} {'above' if gap >= 0 else 'below'} it on average"
