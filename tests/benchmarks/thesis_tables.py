"""The tables beside the thesis: its seeds, its trees, and how soon tasks are solved; `results.py` writes them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from default_tables import ENVIRONMENTS

from ge_torchrl.report.canvas import save_figure
from ge_torchrl.report.evaluation import evaluate
from ge_torchrl.report.figures import convergence_figure
from ge_torchrl.report.findings import by_method, interval_text, method_text, overview_table
from ge_torchrl.report.methods import GE, THESIS
from ge_torchrl.report.refinements import refinements_text
from ge_torchrl.report.runs import Run, read_runs
from ge_torchrl.report.tables import Table
from ge_torchrl.report.thesis.beside import published_beside, refinements_of
from ge_torchrl.report.thesis.pairs import comparison_text, pair_by_seed
from ge_torchrl.report.thesis.solving import env_steps_of, paired_ratio

_TREES = Path(__file__).resolve().parents[2] / "docs" / "trees"
# What PPO refines in the runs of each folder of multirun/solving/ENVIRONMENT, beside those in `alone`.
SOLVING = {
    "cartpole": {"individuals": "individuals"},
    "mountaincar": {
        "individuals": "individuals",
        "neighbours": "individuals, and neighbours of kept trees",
    },
}


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
        path = _TREES / f"thesis_{name}.json"
        found = [evaluate(path, 1000, 0, route) for route in ("gymnasium", "kernel")]
        nodes = found[0].decision_nodes
        means = [f"{one.mean:.3f}" for one in found]
        rows.append([f"{environment}, {nodes} decision nodes", f"{said[name]:.2f}", *means])
    head = ("tree", "thesis, 100 episodes", "Gymnasium route", "kernel route")
    yield "published", Table.of(head, rows).markdown()


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
