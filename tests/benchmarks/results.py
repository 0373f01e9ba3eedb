"""The tables of docs/results.md and README.md, from finished runs; the commands above the tables make the runs.

    python tests/benchmarks/results.py default             # print the tables of the default
    python tests/benchmarks/results.py default --write     # put them between their marks in these pages

A mark is a line such as `<!-- TABLE default -->`; everything up to `<!-- END default -->` is replaced.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from rules_tables import rules_tables, without

from ge_torchrl.artefacts.records import RefinementRecord
from ge_torchrl.errors import UserError
from ge_torchrl.report.canvas import save_figure
from ge_torchrl.report.evaluated import EvaluatedMethod
from ge_torchrl.report.evaluation import evaluate, evaluate_runs
from ge_torchrl.report.figures import convergence_figure
from ge_torchrl.report.findings import by_method, interval_text, method_text, overview_table
from ge_torchrl.report.methods import GE, THESIS
from ge_torchrl.report.refinements import RefinementCounts, count_refinements, refinements_text
from ge_torchrl.report.runs import Run, read_runs
from ge_torchrl.report.tables import Table
from ge_torchrl.report.thesis.beside import published_beside, refinements_of
from ge_torchrl.report.thesis.pairs import comparison_text, pair_by_seed
from ge_torchrl.report.thesis.solving import env_steps_of, paired_ratio

# What PPO refines in the runs of each folder of multirun/solving/ENVIRONMENT, beside those in `alone`.
SOLVING = {
    "cartpole": {"individuals": "individuals"},
    "mountaincar": {
        "individuals": "individuals",
        "neighbours": "individuals, and neighbours of kept trees",
    },
}
DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = (DOCS / "results.md", DOCS.parent / "README.md")
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


def solving_tables(folder: Path, _figures: Path) -> Iterator[tuple[str, str]]:
    """Generations and environment steps to the threshold, against GE alone."""
    head = (
        "PPO refines",
        "pairs",
        "median generations, GE alone",
        "with refinement",
        "median ratio of generations",
        "median ratio of environment steps",
        "never reached",
    )
    rows = []
    for name, ways in SOLVING.items():
        alone = read_runs(folder / "solving" / name / "alone").runs
        for way, words in ways.items():
            treated = read_runs(folder / "solving" / name / way).runs
            rows.append(_solving_row([*alone, *treated], words))
    yield "solving", Table.of(head, rows).markdown()


def thesis_tables(folder: Path, figures: Path) -> Iterator[tuple[str, str]]:
    """Ten seeds beside the thesis' tables, what PPO did in them, and thirty pairs; and the figures."""
    for name, environment in ENVIRONMENTS.items():
        rng = np.random.default_rng(0)
        every = read_runs(folder / "thesis" / name).runs
        ten = [run for run in every if run.method == THESIS and run.seed < 10]
        published = published_beside(THESIS, environment)
        pairs = pair_by_seed(every, THESIS)
        solved_at = every[0].summary.solved_at
        parts = [method_text(ten, rng), "What PPO did in these runs:", refinements_text(ten)]
        parts[-1] += f"\n{refinements_of(published)}" if published else ""
        parts += [f"{len(pairs)} seeds, with PPO and without:", overview_table(every)]
        if solved_at is not None:
            # The table of pairs is long; the lines below it say what it shows.
            parts.append(comparison_text(pairs, solved_at, rng).partition("\n\n")[2])
        histories = {found[0].method: [run.history for run in found] for found in by_method(every)}
        figure = convergence_figure(histories, rng, title=environment, solved_at=solved_at)
        svg, png = save_figure(figure, figures / f"{name}-fitness")
        svg.unlink()
        parts.append(f"![Mean best fitness over generations](figures/{png.name})")
        yield f"thesis-{name}", "\n\n".join(parts)


def published_tables(_folder: Path, _figures: Path) -> Iterator[tuple[str, str]]:
    """The trees printed in the thesis, on both routes."""
    said = {"cartpole": 499.8, "acrobot": -113.89, "mountaincar": -107.89}
    rows = []
    for name, environment in ENVIRONMENTS.items():
        path = DOCS / "trees" / f"thesis_{name}.json"
        found = [evaluate(path, 1000, 0, route) for route in ("gymnasium", "kernel")]
        nodes = found[0].decision_nodes
        means = [f"{one.mean:.3f}" for one in found]
        rows.append([f"{environment}, {nodes} decision nodes", f"{said[name]:.2f}", *means])
    head = ("tree", "thesis, 100 episodes", "Gymnasium route", "kernel route")
    yield "published", Table.of(head, rows).markdown()


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


def _solving_row(runs: Sequence[Run], words: str) -> list[str]:
    method = next(run.method for run in runs if run.method != GE)
    pairs = pair_by_seed(runs, method)
    solved_at = pairs[0].treated.summary.solved_at
    if solved_at is None:
        raise ValueError(f"{pairs[0].treated.environment} must have a threshold to be compared at")
    times = [pair.solving_times(solved_at) for pair in pairs]
    ratio = paired_ratio(times, np.random.default_rng(0))
    steps = paired_ratio(times, np.random.default_rng(0), measure=env_steps_of)
    return [
        f"{pairs[0].treated.environment}: {words}",
        str(len(pairs)),
        f"{np.median([alone.generations for _, alone in times]):g}",
        f"{np.median([treated.generations for treated, _ in times]):g}",
        *(interval_text(found.median, found.interval, len(pairs)) for found in (ratio, steps)),
        f"{ratio.control_censored} alone, {ratio.treated_censored} with",
    ]


def _mean(values: Iterable[float | None]) -> float:
    return float(np.mean([value for value in values if value is not None]))


TABLES = {
    "default": default_tables,
    "rates": rates_tables,
    "solving": solving_tables,
    "thesis": thesis_tables,
    "published": published_tables,
    "rules": rules_tables,
}


def write(name: str, text: str) -> None:
    """Put a text between the marks of a table, in the page that has them."""
    pattern = re.compile(rf"(<!-- TABLE {name} -->\n).*?(<!-- END {name} -->)", flags=re.DOTALL)
    for path in PAGES:
        page = path.read_text(encoding="utf-8")
        if pattern.search(page):
            written = pattern.sub(lambda found: f"{found[1]}\n{text}\n\n{found[2]}", page)
            path.write_text(written, encoding="utf-8")
            return
    raise ValueError(f"a page must have the marks of {name}")


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(description="Make tables of the pages from finished runs.")
    parser.add_argument("names", nargs="+", choices=TABLES, metavar="NAME", help=", ".join(TABLES))
    parser.add_argument(
        "--folder", type=Path, default=Path("multirun"), help="of the runs; default: multirun"
    )
    parser.add_argument("--figures", type=Path, default=DOCS / "figures", help="where figures go")
    parser.add_argument("--write", action="store_true", help="put the tables into their pages")
    options = parser.parse_args(arguments)
    for name in options.names:
        for mark, text in TABLES[name](options.folder, options.figures):
            print(f"\n{mark}\n\n{text}")
            if options.write:
                write(mark, text)


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except UserError as error:
        sys.exit(f"results.py: {error}")
