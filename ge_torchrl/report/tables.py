"""Tables of many runs, from their artefacts alone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby

import numpy as np

from ge_torchrl.records import Summary
from ge_torchrl.report.published import PublishedSweep


def runs_table(summaries: Sequence[Summary], method: str = "") -> str:
    """Return one Markdown table for each environment, a row a run and a last row over all runs.

    The form is that of Tables 4.3, 4.6 and 4.9 of the thesis: training and test fitness of the best tree and its
    complexity, with the size and the time that the thesis does not give.

    Args:
        summaries: Runs in any order.
        method: Named in the titles, if given.
    """
    by_environment = sorted(summaries, key=lambda summary: (summary.environment, summary.seed))
    tables = [
        _environment_table(list(runs), method)
        for _, runs in groupby(by_environment, key=lambda run: run.environment)
    ]
    return "\n\n".join(tables)


def _environment_table(runs: list[Summary], method: str) -> str:
    first = runs[0]
    head = ["seed", "training", "test mean ± sd", "solved", "M", "decision nodes", "evolution s", "all s"]
    rows = [
        [
            str(run.seed),
            f"{run.train_fitness:.2f}",
            f"{run.test_mean:.2f} ± {run.test_std:.2f}",
            _yes(run.solved),
            f"{run.complexity_M:.1f}",
            str(run.decision_nodes),
            f"{run.evolve_seconds:.2f}",
            f"{run.wall_seconds:.2f}",
        ]
        for run in runs
    ]
    rows.append(
        [
            "**all**",
            f"{_mean(run.train_fitness for run in runs):.2f}",
            f"{_mean(run.test_mean for run in runs):.2f}",
            f"**{_share(runs)}**",
            f"{_mean(run.complexity_M for run in runs):.1f}",
            f"{_mean(run.decision_nodes for run in runs):.1f}",
            f"{_mean(run.evolve_seconds for run in runs):.2f}",
            f"{_mean(run.wall_seconds for run in runs):.2f}",
        ]
    )
    threshold = "" if first.solved_at is None else f", solved from {first.solved_at:g}"
    name = f"{first.environment} {method}".rstrip()
    title = f"**{name}** ({first.test_episodes} test episodes{threshold})"
    return f"{title}\n\n{markdown(head, rows)}"


def thesis_table(runs: Sequence[Summary], published: PublishedSweep | None) -> str:
    """Return a Markdown table in the form of Tables 4.3, 4.6 and 4.9, the thesis' numbers beside ours.

    Args:
        runs: Runs of one environment in the order of their rows.
        published: The thesis' runs; None where it has none, and then its columns are left out.
    """
    ours = [[*_numbers(run.train_fitness, run.test_mean, run.complexity_M), _yes(run.solved)] for run in runs]
    columns = zip(*((run.train_fitness, run.test_mean, run.complexity_M) for run in runs), strict=True)
    ours.append([*_numbers(*map(_mean, columns)), _share(runs)])
    head, seeds = ["training", "test", "M", "solved"], [*(str(run.seed) for run in runs), "**mean**"]
    if published is None:
        return markdown(["seed", *head], [[seed, *row] for seed, row in zip(seeds, ours, strict=True)])
    theirs = [*(_published_cells(published, run.seed) for run in runs), _published_means(published)]
    names = [*(f"R{run.seed + 1}" for run in runs), ""]
    rows = [
        [name, seed, *alternating(row, beside)]
        for name, seed, row, beside in zip(names, seeds, ours, theirs, strict=True)
    ]
    return markdown(["run", "seed", *alternating(head, ["thesis"] * 4)], rows)


def published_summary(published: PublishedSweep) -> list[str]:
    """Return what the thesis found in an environment: the solved runs, the mean test return and the mean M."""
    _, test, complexity, solved = _published_means(published)
    return [solved, test, complexity]


def _published_cells(published: PublishedSweep, seed: int) -> list[str]:
    run = published.run_of_seed(seed)
    if run is None:
        return [""] * 4
    return [
        *_numbers(run.train_fitness, run.test_mean, run.complexity_M),
        _yes(published.is_solved(run)),
    ]


def _published_means(published: PublishedSweep) -> list[str]:
    columns = zip(
        *((run.train_fitness, run.test_mean, run.complexity_M) for run in published.runs), strict=True
    )
    return [*_numbers(*map(_mean, columns)), f"{published.solved} of {len(published.runs)}"]


def _numbers(train_fitness: float, test_mean: float, complexity: float) -> list[str]:
    return [f"{train_fitness:.2f}", f"{test_mean:.2f}", f"{complexity:.1f}"]


def _yes(solved: bool | None) -> str:
    return "" if solved is None else "yes" if solved else "no"


def _share(runs: Sequence[Summary]) -> str:
    return f"{sum(bool(run.solved) for run in runs)} of {len(runs)}"


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table, all columns but the first aligned to the right."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def aligned(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table for a terminal, all columns aligned to the right."""
    lines = [head, *rows]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)) for line in lines
    )


def alternating(ours: Sequence[str], theirs: Sequence[str]) -> list[str]:
    """Return two rows as one, a cell of ours and one of theirs in turn."""
    return [cell for pair in zip(ours, theirs, strict=True) for cell in pair]


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))
