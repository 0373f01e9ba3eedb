"""The report of a sweep: one Markdown file with its figures and trees, from artefacts alone."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np

from ge_torchrl import __version__
from ge_torchrl.errors import ArtefactError
from ge_torchrl.report.canvas import save_figure
from ge_torchrl.report.drawing import save_tree
from ge_torchrl.report.figures import convergence_figure, pairs_figure, solving_figure
from ge_torchrl.report.findings import comparison_text, method_text, overview_table, refinements_text
from ge_torchrl.report.hall_of_fame import hall_of_fame_table, size_figure
from ge_torchrl.report.methods import GE, refiner_of
from ge_torchrl.report.runs import FoundRuns, Pair, Run, pair_by_seed, read_runs

REPORT = "report.md"
# The thesis' figure 4.2 shows as many.
_SHOWN_PAIRS = 3
# Intervals are resampled from here, so that equal artefacts give equal reports.
_RESAMPLING_SEED = 0


def write_report(folder: Path, against: Path | None, output: Path) -> Path:
    """Write the report of all finished runs in a folder and below it.

    Args:
        folder: Where the runs are.
        against: Where runs of other methods are, if not there: for every environment the methods that `folder`
            lacks are taken from here.
        output: Folder of the report; what a former report wrote there is replaced.

    Returns:
        Path of the Markdown file.

    Raises:
        ArtefactError: There is no run to report, or the report cannot be written.
        UserError: matplotlib is not installed.
    """
    found = gather_runs(folder, against)
    rng = np.random.default_rng(_RESAMPLING_SEED)
    sections = [_head(folder, found)]
    for _, runs in groupby(found.runs, key=lambda run: run.environment):
        sections += _environment(list(runs), output, rng)
    if found.unreadable:
        sections += ["## Left out", "\n".join(f"* {line}" for line in found.unreadable)]
    path = output / REPORT
    try:
        output.mkdir(parents=True, exist_ok=True)
        path.write_text("\n\n".join(sections) + "\n", encoding="utf-8")
    except OSError as error:
        raise ArtefactError(f"the report {path} cannot be written: {error.strerror}") from error
    return path


def gather_runs(folder: Path, against: Path | None = None) -> FoundRuns:
    """Return the runs of `folder`, and of `against` those of methods that `folder` lacks.

    Args:
        folder: Where the runs are.
        against: Where runs of other methods are, or None.

    Returns:
        Runs in the order of environment, method, seed and path.

    Raises:
        ArtefactError: A folder has no run, or `against` adds none.
    """
    found = read_runs(folder)
    if against is None:
        return found
    environments = {run.environment for run in found.runs}
    present = {(run.environment, run.method) for run in found.runs}
    others = read_runs(against)
    added = [
        run
        for run in others.runs
        if run.environment in environments and (run.environment, run.method) not in present
    ]
    if not added:
        raise ArtefactError(
            f"--against must hold runs of a method that {folder} lacks in the same environment, to compare them; "
            f"those in {against} are of {', '.join(sorted({f'{r.environment} {r.method}' for r in others.runs}))}"
        )
    return FoundRuns.in_order([*found.runs, *added], [*found.unreadable, *others.unreadable])


def best_run(runs: Sequence[Run]) -> Run:
    """Return the run whose champion did best in validation, of equals that with the simplest champion.

    The test is left out of the choice, so that the champion's test mean stays an honest measurement.
    """
    return max(runs, key=lambda run: (run.summary.validation_mean, -run.summary.complexity_M))


def telling_pairs(pairs: Sequence[Pair], solved_at: float) -> list[Pair]:
    """Return the few pairs in which refinement saved most generations, in the order of their seeds."""

    def saved(pair: Pair) -> int:
        refined, plain = (run.solving_time(solved_at).generations for run in pair)
        return plain - refined

    most = sorted(pairs, key=saved, reverse=True)[:_SHOWN_PAIRS]
    return sorted(most, key=lambda pair: pair.refined.seed)


def _head(folder: Path, found: FoundRuns) -> str:
    n = len(found.runs)
    return (
        f"# Report of {folder.resolve().name}\n\n"
        f"{n} finished run{'' if n == 1 else 's'}, read by ge_torchrl {__version__}. {_methods(found.runs)}. Numbers "
        "in brackets are 95 % intervals: Wilson's for rates, bootstrapped over runs for means and medians.\n\n"
        f"{overview_table(found.runs)}"
    )


def _methods(runs: Sequence[Run]) -> str:
    refining = [method for method in dict.fromkeys(run.method for run in runs) if method != GE]
    told = [f", {method} with trees refined by {refiner_of(method)}" for method in sorted(refining)]
    return f"GE is Grammatical Evolution alone{''.join(told)}"


def _environment(runs: list[Run], output: Path, rng: np.random.Generator) -> Iterator[str]:
    environment, solved_at = runs[0].environment, runs[0].summary.solved_at
    methods = {method: list(group) for method, group in groupby(runs, key=lambda run: run.method)}
    yield f"## {environment}"
    if solved_at is not None:
        episodes = runs[0].summary.test_episodes
        yield f"Solved from a mean return of {solved_at:g} on {episodes} unseen episodes."
    for method, members in methods.items():
        yield f"### {environment}: {method}\n\n{method_text(members, rng)}"
        if method != GE:
            yield f"### {environment}: what {refiner_of(method)} did\n\n{refinements_text(members)}"
    compared = {method: pairs for method in methods if method != GE and (pairs := pair_by_seed(runs, method))}
    for method, pairs in compared.items():
        if solved_at is not None:
            yield (
                f"### {environment}: generations to solve, with {refiner_of(method)} and without\n\n"
                f"{comparison_text(pairs, solved_at, rng)}"
            )
    yield from _halls_of_fame(methods, output / "figures" / _slug(f"{environment}-sizes"))
    yield from _figures(methods, output / "figures" / _slug(environment), rng)
    for method, pairs in compared.items():
        if solved_at is not None:
            yield from _pair_figures(pairs, solved_at, output / "figures" / _slug(f"{environment} {method}"))
    for method, members in methods.items():
        yield _best_tree(method, best_run(members), output / "trees" / _slug(f"{environment} {method}"))


def _figures(methods: dict[str, list[Run]], stem: Path, rng: np.random.Generator) -> Iterator[str]:
    first = next(iter(methods.values()))[0]
    histories = {method: [run.history for run in runs] for method, runs in methods.items()}
    yield f"### {first.environment}: figures"
    figure = convergence_figure(histories, rng, title=first.environment, solved_at=first.summary.solved_at)
    yield _image(
        save_figure(figure, stem.with_name(f"{stem.name}-fitness"))[0],
        "Mean best fitness",
        "Mean best training fitness of all runs over generations, refined trees included; the band is the 95 % "
        "bootstrap interval of the mean.",
    )


def _pair_figures(pairs: Sequence[Pair], solved_at: float, stem: Path) -> Iterator[str]:
    environment, method, refiner = pairs[0].refined.environment, pairs[0].method, refiner_of(pairs[0].method)
    figure = solving_figure(pairs, title=environment, solved_at=solved_at)
    yield _image(
        save_figure(figure, stem.with_name(f"{stem.name}-solving"))[0],
        "Generations to solve",
        f"Generations until the best training fitness reaches the threshold, for every seed, {method} and GE alone.",
    )
    shown = telling_pairs(pairs, solved_at)
    figure = pairs_figure(shown, title=environment, solved_at=solved_at)
    chosen = "" if len(shown) == len(pairs) else f" The pairs in which {refiner} saved most are shown."
    yield _image(
        save_figure(figure, stem.with_name(f"{stem.name}-pairs"))[0],
        "Single runs",
        f"Single runs: {method} solid, GE alone dotted, rings where {refiner} was applied or, where it was applied "
        f"often, gave a new best.{chosen}",
    )


def _halls_of_fame(methods: dict[str, list[Run]], path: Path) -> Iterator[str]:
    keeping = {
        method: kept for method, runs in methods.items() if (kept := [r for r in runs if r.hall_of_fame])
    }
    if not keeping:
        return
    first = next(iter(keeping.values()))[0]
    for method, runs in keeping.items():
        yield (
            f"### {first.environment}: the best trees of each size, {method}\n\n{hall_of_fame_table(runs)}\n\n"
            "Each tree was chosen by validation; the column before the last is the test mean of the one that did best "
            "there, of all runs."
        )
    figure = size_figure(keeping, title=first.environment, solved_at=first.summary.solved_at)
    yield _image(
        save_figure(figure, path)[0],
        "Test mean against size",
        "Test mean of each run's best tree of each size, and the median over runs.",
    )


def _best_tree(method: str, run: Run, stem: Path) -> str:
    pruned, _ = save_tree(run.pruned.tree, run.pruned.labels, stem)
    full, _ = save_tree(run.full.tree, run.full.labels, stem.with_name(f"{stem.name}-full"))
    caption = (
        f"Seed {run.seed}, pruned: test mean {run.summary.test_mean:.2f}, M = {run.summary.complexity_M:g}. "
        "It is the best in validation, so that the test stays unseen."
    )
    decisions = run.full.tree.n_decision_nodes
    return (
        f"### {run.environment}: the best tree of {method}\n\n{_image(pruned, 'The tree', caption)}\n\n"
        f"[In full](trees/{full.name}): {decisions} decision node{'' if decisions == 1 else 's'} before pruning."
    )


def _image(path: Path, name: str, caption: str) -> str:
    return f"![{name}]({path.parent.name}/{path.name})\n\n*{caption}*"


def _slug(text: str) -> str:
    return re.sub(r"[^a-z0-9.]+", "-", text.lower())
