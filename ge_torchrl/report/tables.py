"""Tables of many runs, from their artefacts alone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby

import numpy as np

from ge_torchrl.artefacts import Summary


def runs_table(summaries: Sequence[Summary]) -> str:
    """Return one Markdown table for each environment, a row a run and a last row over all runs.

    The form is that of Tables 4.3, 4.6 and 4.9 of the thesis: training and test fitness of the best tree and its
    complexity, with the size and the time that the thesis does not give.

    Args:
        summaries: Runs in any order.
    """
    by_environment = sorted(summaries, key=lambda summary: (summary.environment, summary.seed))
    tables = [
        _environment_table(list(runs)) for _, runs in groupby(by_environment, key=lambda run: run.environment)
    ]
    return "\n\n".join(tables)


def _environment_table(runs: list[Summary]) -> str:
    first = runs[0]
    head = ["seed", "training", "test mean ± sd", "solved", "M", "decision nodes", "evolution s", "all s"]
    rows = [
        [
            str(run.seed),
            f"{run.train_fitness:.2f}",
            f"{run.test_mean:.2f} ± {run.test_std:.2f}",
            "" if run.solved is None else "yes" if run.solved else "no",
            f"{run.complexity_M:.1f}",
            str(run.decision_nodes),
            f"{run.evolve_seconds:.2f}",
            f"{run.wall_seconds:.2f}",
        ]
        for run in runs
    ]
    solved = sum(bool(run.solved) for run in runs)
    rows.append(
        [
            "**all**",
            f"{_mean(run.train_fitness for run in runs):.2f}",
            f"{_mean(run.test_mean for run in runs):.2f}",
            f"**{solved} of {len(runs)}**",
            f"{_mean(run.complexity_M for run in runs):.1f}",
            f"{_mean(run.decision_nodes for run in runs):.1f}",
            f"{_mean(run.evolve_seconds for run in runs):.2f}",
            f"{_mean(run.wall_seconds for run in runs):.2f}",
        ]
    )
    threshold = "" if first.solved_at is None else f", solved from {first.solved_at:g}"
    title = f"**{first.environment}** ({first.test_episodes} test episodes{threshold})"
    return f"{title}\n\n{markdown(head, rows)}"


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table, all columns but the first aligned to the right."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))
