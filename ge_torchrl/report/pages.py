"""The report of a sweep: one Markdown file with its figures and trees, from artefacts alone."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from zlib import crc32

import numpy as np

from ge_torchrl.artefacts.texts import told_of, write_text
from ge_torchrl.printing import in_markdown
from ge_torchrl.report.canvas import save_figure
from ge_torchrl.report.drawing import save_tree
from ge_torchrl.report.figures import convergence_figure, starts_of
from ge_torchrl.report.findings import method_text, overview_table
from ge_torchrl.report.methods import GE, METHODS, THESIS, added_by, refiner_of
from ge_torchrl.report.refinements import refinements_text
from ge_torchrl.report.runs import FoundRuns, Run, best_run, gather_runs
from ge_torchrl.report.sizes import are_of_one_run, by_size, sizes_figure, sizes_table
from ge_torchrl.report.statistics import FEW
from ge_torchrl.report.tables import counted
from ge_torchrl.report.thesis.beside import published_beside, refinements_of
from ge_torchrl.report.thesis.figures import pairs_figure, ringed, solving_figure
from ge_torchrl.report.thesis.pairs import Pair, comparison_text, pair_by_seed, telling_pairs
from ge_torchrl.version import __version__

REPORT = "report.md"
# A file system ends a name at 255 bytes.
_LONGEST_NAME = 120
# Intervals are resampled from here, so that equal artefacts give equal reports.
_RESAMPLING_SEED = 0
_ANEW = " A line breaks where the runs begin anew with another population."
_BY_SIZE = (
    "Each run chose its trees in validation on episodes of its own. The tree to take is the best in validation of all "
    "runs; the best of runs is chosen by the test itself, so its mean flatters."
)


def write_report(folder: Path, against: Path | None, output: Path, found: FoundRuns | None = None) -> Path:
    """Write the report of all finished runs in a folder and below it.

    Args:
        folder: Where the runs are.
        against: Where runs of other methods are, if not there: for every environment the methods that `folder`
            lacks are taken from here.
        output: Folder of the report; what a former report wrote there is replaced.
        found: These runs, where they are read already.

    Returns:
        Path of the Markdown file.

    Raises:
        ArtefactError: There is no run to report, or the report cannot be written.
        UserError: matplotlib is not installed.
    """
    found = found or gather_runs(folder, against)
    rng = np.random.default_rng(_RESAMPLING_SEED)
    sections = [_head(folder, found)]
    for _, runs in groupby(found.runs, key=lambda run: run.environment):
        sections += _environment(list(runs), output, rng)
    if found.left_out:
        sections += ["## Left out", "\n".join(f"* {in_markdown(line)}" for line in found.left_out)]
    path = output / REPORT
    with told_of(output):
        output.mkdir(parents=True, exist_ok=True)
    write_text(path, "\n\n".join(sections) + "\n")
    return path


def _head(folder: Path, found: FoundRuns) -> str:
    return (
        f"# Report of {in_markdown(folder.resolve().name)}\n\n"
        f"{counted(len(found.runs), 'finished run')}, read by ge_torchrl {__version__}. {_methods(found.runs)}. "
        "Numbers in brackets are 95 % intervals: Wilson's for rates, bootstrapped over runs for means and medians. "
        f"Fewer than {FEW} runs give no such interval, but the range of what they say.\n\n"
        f"{overview_table(found.runs)}"
    )


def _methods(runs: Sequence[Run]) -> str:
    present = {run.method for run in runs}
    told = [f", {method} {_described(method)}" for method in METHODS if method in present - {GE}]
    return f"GE is Grammatical Evolution alone{''.join(told)}"


def _described(method: str) -> str:
    return "with PPO as the thesis applies it" if method == THESIS else f"with {added_by(method)}"


def _environment(runs: list[Run], output: Path, rng: np.random.Generator) -> Iterator[str]:
    environment, solved_at = runs[0].environment, runs[0].summary.solved_at
    groups = {label: list(group) for label, group in groupby(runs, key=lambda run: run.label)}
    yield f"## {in_markdown(environment)}"
    if solved_at is not None:
        episodes = runs[0].summary.test_episodes
        yield f"Solved from a mean return of {solved_at:g} on {episodes} unseen episodes."
    for label, members in groups.items():
        yield f"### {in_markdown(environment)}: {in_markdown(label)}\n\n{method_text(members, rng)}"
        method = members[0].method
        if refiner := refiner_of(method):
            published = published_beside(method, environment)
            theirs = "" if published is None else f"\n{refinements_of(published)}"
            title = f"### {in_markdown(environment)}: what {refiner} did in {in_markdown(label)}"
            yield f"{title}\n\n{refinements_text(members)}{theirs}"
    plain = [run for run in runs if run.method == GE]
    compared = {
        label: pairs
        for label, members in groups.items()
        if members[0].method != GE and (pairs := pair_by_seed([*members, *plain], members[0].method))
    }
    for label, pairs in compared.items():
        if solved_at is not None:
            yield (
                f"### {in_markdown(environment)}: generations to solve, {in_markdown(label)} and GE alone\n\n"
                f"{comparison_text(pairs, solved_at, rng)}"
            )
    yield from _sizes(groups, output / "figures" / _slug(f"{environment}-sizes"))
    yield from _figures(groups, output / "figures" / _slug(environment), rng)
    for label, pairs in compared.items():
        if solved_at is not None:
            yield from _pair_figures(pairs, solved_at, output / "figures" / _slug(f"{environment} {label}"))
    for label, members in groups.items():
        yield _best_tree(label, best_run(members), output / "trees" / _slug(f"{environment} {label}"))


def _figures(methods: Mapping[str, Sequence[Run]], stem: Path, rng: np.random.Generator) -> Iterator[str]:
    first = next(iter(methods.values()))[0]
    histories = {method: [run.history for run in runs] for method, runs in methods.items()}
    yield f"### {in_markdown(first.environment)}: figures"
    starts = {method: starts_of(runs) for method, runs in methods.items()}
    anew = _ANEW * any(starts.values())
    figure = convergence_figure(
        histories, rng, title=first.environment, solved_at=first.summary.solved_at, starts=starts
    )
    yield _image(
        save_figure(figure, stem.with_name(f"{stem.name}-fitness"))[0],
        "Mean best fitness",
        f"Mean best training fitness of all runs over generations, refined trees included.{_bands(methods)}{anew}",
    )


def _bands(methods: Mapping[str, Sequence[Run]]) -> str:
    """Return what the bands around the means of methods are."""
    numbers = [len(runs) for runs in methods.values() if len(runs) > 1]
    told = [
        *(["the 95 % bootstrap interval of the mean"] if max(numbers, default=0) >= FEW else []),
        *([f"where runs are fewer than {FEW}, what they span"] if min(numbers, default=FEW) < FEW else []),
    ]
    return f" The band is {'; '.join(told)}." if told else ""


def _pair_figures(pairs: Sequence[Pair], solved_at: float, stem: Path) -> Iterator[str]:
    environment, method = pairs[0].treated.environment, pairs[0].method
    added = added_by(method)
    figure = solving_figure(pairs, title=environment, solved_at=solved_at)
    yield _image(
        save_figure(figure, stem.with_name(f"{stem.name}-solving"))[0],
        "Generations to solve",
        f"Generations until the best training fitness reaches the threshold, for every seed, {method} and GE alone.",
    )
    shown = telling_pairs(pairs, solved_at)
    figure = pairs_figure(shown, title=environment, solved_at=solved_at)
    refiner = refiner_of(method)
    rings = f", rings where {refiner} refined a tree or, where it refined many, gave a new best" * any(
        ringed(pair.treated) for pair in shown
    )
    anew = _ANEW * bool(starts_of(run for pair in shown for run in pair))
    chosen = "" if len(shown) == len(pairs) else f" The pairs in which {added} saved most are shown."
    yield _image(
        save_figure(figure, stem.with_name(f"{stem.name}-pairs"))[0],
        "Single runs",
        f"Single runs: {method} solid, GE alone dotted{rings}.{chosen}{anew}",
    )


def _sizes(methods: Mapping[str, Sequence[Run]], path: Path) -> Iterator[str]:
    rows_of = {
        method: rows
        for method, runs in methods.items()
        if (rows := by_size(tree for run in runs for tree in run.by_size))
    }
    if not rows_of:
        return
    first = next(iter(methods.values()))[0]
    for method, rows in rows_of.items():
        title = f"### {in_markdown(first.environment)}: the best trees of each size, {in_markdown(method)}"
        yield f"{title}\n\n{sizes_table(rows).markdown()}"
        if not are_of_one_run(rows):
            yield _BY_SIZE
    figure = sizes_figure(rows_of, title=first.environment, solved_at=first.summary.solved_at)
    yield _image(
        save_figure(figure, path)[0],
        "Test mean against decision nodes",
        "Test mean of each run's best tree of each size, and the median over runs.",
    )


def _best_tree(method: str, run: Run, stem: Path) -> str:
    pruned, _ = save_tree(run.pruned, stem)
    full, _ = save_tree(run.full, stem.with_name(f"{stem.name}-full"))
    caption = (
        f"Seed {run.seed}, pruned: test mean {run.summary.test_mean:.2f}, M = {run.summary.complexity_M:g}. "
        "It is the best in validation, so that the test stays unseen."
    )
    decisions = counted(run.full.tree.num_decision_nodes, "decision node")
    return (
        f"### {in_markdown(run.environment)}: the best tree of {in_markdown(method)}\n\n"
        f"{_image(pruned, 'The tree', caption)}\n\n"
        f"[In full](trees/{full.name}): {decisions} before pruning."
    )


def _image(path: Path, name: str, caption: str) -> str:
    return f"![{name}]({path.parent.name}/{path.name})\n\n*{caption}*"


def _slug(text: str) -> str:
    slug = re.sub(r"[^a-z0-9.]+", "-", text.lower())
    return slug if len(slug) <= _LONGEST_NAME else f"{slug[:_LONGEST_NAME]}-{crc32(text.encode()):x}"
