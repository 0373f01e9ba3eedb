"""The tables of the default, and of what PPO's refinements do; `results.py` writes them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from rules_tables import without

from ge_torchrl.artefacts.records import RefinementRecord
from ge_torchrl.report.evaluated import EvaluatedMethod
from ge_torchrl.report.evaluation import evaluate_runs
from ge_torchrl.report.findings import by_method
from ge_torchrl.report.refinements import RefinementCounts, count_refinements
from ge_torchrl.report.runs import Run, read_runs
from ge_torchrl.report.tables import Table

ENVIRONMENTS = {"cartpole": "CartPole-v1", "acrobot": "Acrobot-v1", "mountaincar": "MountainCar-v0"}
EPISODES, FIRST_SEED = 10_000, 1_000_000
# The best known means of trees with 1, 2, ... decision nodes, by half an hour of brute force.
POSSIBLE = {
    "CartPole-v1": (199.2, 499.99, 500, 500),
    "Acrobot-v1": (-84.3, -79.1, -77.3, -74.8, -72.2, -71.0, -70.2, -69.7),
    "MountainCar-v0": (-119.4, -115.5, -100.3, -98.7, -98.6, -98.6, -97.9, -97.9),
}
PUBLISHED = {
    "CartPole-v1": "500.00 with 2",
    "Acrobot-v1": "-75 with 86, -72 with a network",
    "MountainCar-v0": "-100.42 with 4, -99.2 with 13",
}
# The sizes whose trees the first table shows.
SHOWN = {"CartPole-v1": (2, 3), "Acrobot-v1": (3, 5, 8), "MountainCar-v0": (3, 4, 7)}
ORIGINS = {"individual": "individuals", "neighbour": "neighbours", "archive": "kept trees"}


def default_tables(folder: Path, _figures: Path) -> Iterator[tuple[str, str]]:
    """The default: in short, by size, by seed, and what PPO and the polish did in these runs."""
    methods = [
        method
        for name in ENVIRONMENTS
        for method in evaluate_runs(folder / "default" / name, EPISODES, FIRST_SEED).methods
    ]
    yield "default", _in_short(methods).markdown()
    yield "summary", without(_in_short(methods), "worst run", "seconds a run, median").markdown()
    yield "default-sizes", _by_size(methods).markdown()
    yield "default-seeds", _by_seed(methods).markdown()
    runs = [run for name in ENVIRONMENTS for run in read_runs(folder / "default" / name).runs]
    yield "default-refinements", _refinements(runs).markdown()


def rates_tables(folder: Path, _figures: Path) -> Iterator[tuple[str, str]]:
    """Refinements of individuals, before and after on the same fresh episodes."""
    runs = [run for name in ENVIRONMENTS for run in read_runs(folder / "rates" / name).runs]
    yield "rates", _refinements(runs).markdown()


def _in_short(methods: Iterable[EvaluatedMethod]) -> Table:
    head = (
        "environment",
        "solved",
        "worst run",
        "median run",
        "best of ten in validation, with decision nodes",
        "published",
        "seconds a run, median",
    )

    def row(method: EvaluatedMethod) -> Iterator[str]:
        yield method.environment
        yield f"{method.solved} of {len(method.runs)}"
        yield f"{min(method.means):.2f}"
        yield f"{np.median(method.means):.2f}"
        best = {size.decision_nodes: size.in_validation.mean for size in method.sizes}
        shown = SHOWN[method.environment]
        yield ", ".join(f"{best[nodes]:.2f} with {nodes}" for nodes in shown if nodes in best)
        yield PUBLISHED[method.environment]
        yield f"{np.median([run.row.wall_seconds for run in method.runs]):.0f}"

    return Table.of(head, map(row, methods))


def _by_size(methods: Iterable[EvaluatedMethod]) -> Table:
    table = Table.of(["decision nodes"], [[str(nodes)] for nodes in range(1, 9)])
    for method in methods:
        possible = POSSIBLE[method.environment]
        sizes = {size.decision_nodes: size for size in method.sizes}
        rows = [
            [
                f"{possible[nodes - 1]:.2f}" if nodes <= len(possible) else "",
                f"{sizes[nodes].median:.2f}" if nodes in sizes else "",
                f"{sizes[nodes].in_validation.mean:.2f}" if nodes in sizes else "",
            ]
            for nodes in range(1, 9)
        ]
        table = table.beside(Table.of([f"{method.environment}: possible", "one run", "of ten"], rows))
    return table


def _by_seed(methods: Iterable[EvaluatedMethod]) -> Table:
    """Return a row a seed, with a blank where an environment has no run of it."""
    ran = [(method.environment, {run.row.seed: run.row for run in method.runs}) for method in methods]
    seeds = sorted({seed for _, rows in ran for seed in rows})
    table = Table.of(["seed"], [[str(seed)] for seed in seeds])
    for environment, rows in ran:
        cells = [
            [
                str(rows[seed].decision_nodes),
                f"{rows[seed].mean:.2f} ± {rows[seed].std:.2f}",
                f"{rows[seed].wall_seconds:.0f}",
            ]
            if seed in rows
            else [""] * 3
            for seed in seeds
        ]
        table = table.beside(Table.of([f"{environment}: nodes", "mean ± sd", "s"], cells))
    return table


def _refinements(runs: Iterable[Run]) -> Table:
    head = (
        "environment",
        "trees",
        "refined",
        "better",
        "worse",
        "mean before",
        "soft tree",
        "hard tree",
        "snapped to the grammar",
        "seconds a tree",
    )
    rows = []
    for found in by_method(list(runs)):
        records = [record for run in found for record in run.refinements if record.outcome != "skipped"]
        for origin, name in ORIGINS.items():
            some = [record for record in records if record.origin == origin]
            if not some:
                continue
            counts = count_refinements(some)
            rows.append(
                [
                    found[0].environment,
                    name,
                    f"{counts.applied:,}",
                    f"{counts.beyond_return:,} ({counts.beyond_return / counts.applied:.0%})",
                    f"{counts.below_return:,}",
                    *_way(some, counts),
                    f"{_mean(record.refine_seconds for record in some):.2f}",
                ]
            )
    return Table.of(head, rows).without_empty_columns()


def _way(records: list[RefinementRecord], counts: RefinementCounts) -> list[str]:
    """The mean return before, of the soft tree, of the hard one, and of what the grammar's constants leave of it."""
    way = counts.bridges
    # Where few trees were snapped, their way is not that of the others.
    if way is None or way.applications < 0.9 * len(records):
        before = _mean(record.return_before for record in records)
        after = _mean(record.return_after for record in records)
        return [f"{before:.1f}", "", f"{after:.1f}", ""]
    soft = "" if way.soft is None else f"{way.soft:.1f}"
    return [f"{way.before:.1f}", soft, f"{way.after:.1f}", f"{way.snapped:.1f}"]


def _mean(values: Iterable[float | None]) -> float:
    return float(np.mean([value for value in values if value is not None]))
