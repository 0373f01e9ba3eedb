"""The page of a sweep: runs of equal settings side by side, and what came of every job."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ge_torchrl.report.html.figures import number, seconds
from ge_torchrl.report.html.places import name_below, named, page_of, short_names
from ge_torchrl.report.html.template import Markup, element, filled, joined, table
from ge_torchrl.report.jobs import UnfinishedJob, unfinished_jobs
from ge_torchrl.report.runs import FoundRuns, Run, best_run
from ge_torchrl.report.settings import differing, labels_of, shown_setting
from ge_torchrl.report.sizes import by_size, sizes_table
from ge_torchrl.report.statistics import FEW, spread_of, wilson_interval
from ge_torchrl.report.tables import counted
from ge_torchrl.version import __version__

# Intervals are resampled from here, so that equal artefacts give equal pages.
_RESAMPLING_SEED = 0
_NOTHING_DIFFERS = "all with the same settings"


class Group(NamedTuple):
    """Runs of one environment that differ in their seeds alone.

    Attributes:
        label: The settings that the environment's other runs have otherwise.
        runs: At least one.
    """

    label: str
    runs: list[Run]


def groups_of(runs: Sequence[Run]) -> tuple[list[str], list[Group]]:
    """Return the settings that differ between runs of one environment, and the runs by their values.

    Args:
        runs: Of one environment; those of other versions of the program are told apart too.
    """
    configs = [run.config for run in runs]
    versions = len({run.summary.version for run in runs}) > 1
    groups: dict[str, list[Run]] = {}
    for run, setting in zip(runs, labels_of(configs), strict=True):
        parts = [*([setting] if setting else []), *([f"version {run.summary.version}"] if versions else [])]
        groups.setdefault(", ".join(parts) or _NOTHING_DIFFERS, []).append(run)
    return differing(configs), [Group(label, members) for label, members in groups.items()]


def sweep_page(folder: Path, found: FoundRuns) -> str:
    """Return the page of a sweep.

    Args:
        folder: The folder that the runs lie in.
        found: Its finished runs.
    """
    rng = np.random.default_rng(_RESAMPLING_SEED)
    unfinished = unfinished_jobs(folder)
    sections = [
        _environment(list(runs), folder, rng)
        for _, runs in groupby(found.runs, key=lambda run: run.environment)
    ]
    values = {
        "title": f"{folder.resolve().name}: {counted(len(found.runs), 'run')}",
        "name": folder.resolve().name,
        "verdict": _verdict(found.runs, unfinished, found.unreadable),
        "sections": joined(sections),
        "left_out": _left_out(folder, unfinished, found),
        "version": __version__,
    }
    return filled("sweep.html", (), {}, values)


def _verdict(runs: Sequence[Run], unfinished: Sequence[UnfinishedJob], unreadable: Sequence[str]) -> Markup:
    judged = [run.summary.solved for run in runs if run.summary.solved is not None]
    parts: list[str] = [element("strong", counted(len(runs), "finished run"))]
    if judged:
        parts.append(
            f"; {sum(judged)} of {len(judged)} solved {'their task' if len(judged) > 1 else 'its task'}"
        )
    failed = sum(job.state == "failed" for job in unfinished)
    open_jobs = len(unfinished) - failed
    if failed:
        parts.append(f"; {counted(failed, 'job')} failed")
    if open_jobs:
        parts.append(f"; {counted(open_jobs, 'job')} not finished")
    if unreadable:
        parts.append(f"; {counted(len(unreadable), 'run')} could not be read")
    return element("p", joined([*parts, "."]), class_="verdict")


def _environment(runs: list[Run], folder: Path, rng: np.random.Generator) -> Markup:
    keys, groups = groups_of(runs)
    summary = runs[0].summary
    told = [f"{counted(len(runs), 'run')}, "]
    told.append(f"which differ in {', '.join(keys)}." if keys else f"{_NOTHING_DIFFERS}.")
    if summary.solved_at is not None:
        told.append(f" Solved from a mean return of {summary.solved_at:g}.".replace("-", "\u2212"))
    parts = [
        element("h2", runs[0].environment),
        element("p", "".join(told), class_="lead"),
        _dots(groups, folder, rng),
        _groups_table(groups, rng),
        _runs_table(runs, keys, folder),
        *(_sizes(group) for group in groups if any(run.archive for run in group.runs)),
    ]
    return element("section", joined(parts))


def _dots(groups: Sequence[Group], folder: Path, rng: np.random.Generator) -> Markup:
    """Return a row a group with a dot a run at its mean test return, and the interval of their mean."""
    means = [run.summary.test_mean for group in groups for run in group.runs]
    solved_at = groups[0].runs[0].summary.solved_at
    marks = [*means, *([solved_at] if solved_at is not None else [])]
    low, high = min(marks), max(marks)
    room = 0.04 * (high - low) or 1.0
    low, high = low - room, high + room

    def left(value: float) -> str:
        return f"left:{100 * (value - low) / (high - low):.2f}%"

    threshold = [element("i", class_="at-solved", style=left(solved_at))] if solved_at is not None else []
    rows: list[str] = []
    for group in groups:
        returns = [run.summary.test_mean for run in group.runs]
        dots = [_dot(run, folder, left(run.summary.test_mean)) for run in group.runs]
        band = []
        if len(returns) >= FEW:
            interval = spread_of(returns, rng)
            width = 100 * (interval.high - interval.low) / (high - low)
            band = [element("i", class_="band", style=f"{left(interval.low)};width:{max(width, 0.3):.2f}%")]
        rows.append(element("div", group.label, class_="name"))
        rows.append(element("div", joined([*threshold, *band, *dots]), class_="lane"))
    ends = joined(
        [element("span", number(low)), element("span", "mean test return"), element("span", number(high))]
    )
    rows += [element("div", "", class_="name"), element("div", ends, class_="ends")]
    note = "A dot is a run, and leads to its page."
    if any(len(group.runs) >= FEW for group in groups):
        note += f" The bar is the 95 % interval of the mean over runs, where there are {FEW} or more."
    if solved_at is not None:
        note += " The green line is where the task counts as solved."
    return element(
        "figure",
        joined([element("div", joined(rows), class_="lanes"), element("figcaption", note)]),
        class_="card",
    )


def _dot(run: Run, folder: Path, place: str) -> Markup:
    told = f"seed {run.seed}: {number(run.summary.test_mean)}, {counted(run.summary.decision_nodes, 'decision node')}"
    link = page_of(run.path, folder)
    return element(
        "a" if link else "span", "", class_="dot", style=place, title=told, href=link, aria_label=told
    )


def _groups_table(groups: Sequence[Group], rng: np.random.Generator) -> Markup:
    head = [
        "settings",
        "runs",
        "solved",
        "mean test return",
        "median",
        "decision nodes",
        "M",
        "time of a run",
    ]
    return table(head, [[*_group_cells(group, rng)] for group in groups], caption="Settings side by side")


def _group_cells(group: Group, rng: np.random.Generator) -> Iterator[str]:
    summaries = [run.summary for run in group.runs]
    yield group.label
    yield str(len(summaries))
    judged = [summary.solved for summary in summaries if summary.solved is not None]
    if judged:
        rate = wilson_interval(sum(judged), len(judged))
        yield f"{sum(judged)} of {len(judged)} ({rate.low:.0%} to {rate.high:.0%})"
    else:
        yield ""
    yield _with_interval([summary.test_mean for summary in summaries], rng)
    yield number(float(np.median([summary.test_mean for summary in summaries])))
    sizes = [summary.decision_nodes for summary in summaries]
    yield (
        str(sizes[0]) if min(sizes) == max(sizes) else f"{np.mean(sizes):.1f} ({min(sizes)} to {max(sizes)})"
    )
    yield number(float(np.mean([summary.complexity_M for summary in summaries])), 1)
    yield seconds(float(np.mean([summary.wall_seconds for summary in summaries])))


def _with_interval(values: Sequence[float], rng: np.random.Generator) -> str:
    mean = number(float(np.mean(values)))
    if len(values) == 1:
        return mean
    low, high = spread_of(values, rng)
    return f"{mean} ({'range ' * (len(values) < FEW)}{number(low)} to {number(high)})"


def _runs_table(runs: Sequence[Run], keys: Sequence[str], folder: Path) -> Markup:
    best, names = best_run(runs), short_names(runs, folder)
    head = ["run", *keys, "seed", "decision nodes", "M", "validation", "test mean", "± sd", "solved", "time"]
    rows = [
        [_run_cell(run, names[run.path], folder, is_best=run is best), *_run_cells(run, keys)] for run in runs
    ]
    caption = (
        "Every run"
        if len(runs) == 1
        else "Every run; the one marked did best in validation, which the test had no part in"
    )
    return table(head, rows, caption=caption)


def _run_cell(run: Run, short: str, folder: Path, *, is_best: bool) -> Markup:
    """Return the cell that names a run and leads to its page."""
    link, whole = page_of(run.path, folder), name_below(run.path, folder)
    name = element("a" if link else "span", short, class_="folder", title=whole, href=link)
    best = [" ", element("span", "best in validation", class_="badge solved")] if is_best else []
    return joined([name, *best])


def _run_cells(run: Run, keys: Sequence[str]) -> Iterator[str]:
    summary = run.summary
    for key in keys:
        yield shown_setting(run.config, key)
    yield str(run.seed)
    yield str(summary.decision_nodes)
    yield f"{summary.complexity_M:g}"
    yield number(summary.validation_mean)
    yield number(summary.test_mean)
    yield number(summary.test_std)
    yield {True: "yes", False: "no", None: ""}[summary.solved]
    yield seconds(summary.wall_seconds)


def _sizes(group: Group) -> Markup:
    rows = by_size(tree for run in group.runs for tree in run.by_size)
    if not rows:
        return Markup("")
    sized = sizes_table(rows)
    inner = table(sized.head, sized.rows, caption="")
    title = f"The best trees of each size: {group.label}"
    return element("details", joined([element("summary", title), inner]))


def _left_out(folder: Path, jobs: Sequence[UnfinishedJob], found: FoundRuns) -> Markup:
    rows = [
        [named(job.name, page_of(job.path, folder) if job.path else None), job.state, job.told]
        for job in jobs
    ]
    for line in found.unreadable:
        name, _, told = line.partition(": ")
        rows.append([named(name, None), "unreadable", told])
    for twin in found.twins:
        told = f"has the configuration and seed of {name_below(twin.of, folder)}"
        rows.append([named(name_below(twin.path, folder), page_of(twin.path, folder)), "again", told])
    if not rows:
        return Markup("")
    parts = [
        element("h2", "In no figure"),
        element("p", "These jobs and runs are counted in no figure above.", class_="lead"),
        table(("job", "state", "what is known"), rows),
    ]
    return element("section", joined(parts))
