"""What many runs show, in words and tables of Markdown that are computed from them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import groupby

import numpy as np

from ge_torchrl.report.methods import GE_PPO, METHODS, refiner_of
from ge_torchrl.report.published import PUBLISHED, PublishedSweep
from ge_torchrl.report.refinements import Bridges, count_refinements
from ge_torchrl.report.runs import Pair, Run, unequal_sections
from ge_torchrl.report.statistics import (
    Interval,
    PairedRatio,
    SolvingTime,
    bootstrap_interval,
    env_steps_of,
    generations_of,
    paired_ratio,
    wilson_interval,
)
from ge_torchrl.report.tables import alternating, markdown, published_summary, runs_table, thesis_table


def runs_tables(runs: Sequence[Run]) -> str:
    """Return tables of all runs with their sizes and times, by method where there are several.

    Args:
        runs: Runs in any order.
    """
    methods = [method for method in METHODS if any(run.method == method for run in runs)]
    tables = [
        runs_table([run.summary for run in runs if run.method == method], method if len(methods) > 1 else "")
        for method in methods
    ]
    return "\n\n".join(tables)


def overview_table(runs: Sequence[Run]) -> str:
    """Return a Markdown table, a row an environment and method, the thesis' numbers beside those of GE+PPO.

    Args:
        runs: Runs of an environment and method side by side.
    """
    rows, theirs = [], []
    for (environment, method), group in groupby(runs, key=lambda run: (run.environment, run.method)):
        members = list(group)
        rows.append(
            [
                f"{environment} {method}",
                str(len(members)),
                _solved(members),
                f"{np.mean([run.summary.test_mean for run in members]):.2f}",
                f"{np.mean([run.summary.complexity_M for run in members]):.1f}",
            ]
        )
        theirs.append(_published(members))
    head = ["method", "runs", "solved", "mean test return", "mean M"]
    if not any(theirs):
        return markdown(head, rows)
    thesis = [["", "", ""] if published is None else published_summary(published) for published in theirs]
    beside = [[*row[:2], *alternating(row[2:], numbers)] for row, numbers in zip(rows, thesis, strict=True)]
    return markdown([*head[:2], *alternating(head[2:], ["thesis"] * 3)], beside)


def method_text(runs: Sequence[Run], rng: np.random.Generator) -> str:
    """Return the table of runs, the thesis' numbers beside those of GE+PPO, and what the table shows.

    Args:
        runs: Runs of one environment and method.
        rng: Draws the resamples of intervals.
    """
    published = _published(runs)
    trained = [run.summary.train_fitness for run in runs]
    tested = [run.summary.test_mean for run in runs]
    lines = []
    if runs[0].summary.solved_at is not None:
        lines.append(f"* Solved: {_solved(runs)}.")
    lines += [
        f"* Mean training fitness: {_mean(trained, rng)}.",
        f"* Mean test return: {_mean(tested, rng)}. The training fitness is {_gap(trained, tested)}.",
        f"* Mean complexity M: {_mean([run.summary.complexity_M for run in runs], rng)}.",
    ]
    if len({run.seed for run in runs}) < len(runs):
        lines.append("* Some seeds stand more than once; what pairs runs by seed takes the first of them.")
    table = thesis_table([run.summary for run in runs], published)
    source = "" if published is None else f"\n\n{_source(published.table)}"
    return f"{table}{source}\n\n" + "\n".join(lines)


def refinements_text(runs: Sequence[Run]) -> str:
    """Return how many refinements improved a tree, by both ways of counting, and what was lost on the way.

    Args:
        runs: Runs of one method with refined trees in one environment.
    """
    counts = count_refinements(record for run in runs for record in run.refinements)
    rows = {
        "return after > fitness before, as the thesis counts": counts.beyond_fitness,
        "return after > return before, on the same unseen episodes": counts.beyond_return,
        "best of its generation": counts.new_best,
        "written back into the population": counts.written_back,
        "some threshold moved": counts.moved_thresholds,
        "some leaf changed its action": counts.changed_leaves,
        "training broke off": counts.failed,
    }
    refiner = refiner_of(runs[0].method)
    table = markdown(
        [f"applications of {refiner}", f"of {counts.applied}"], [[what, str(n)] for what, n in rows.items()]
    )
    lines = [] if counts.bridges is None else [_bridges(counts.bridges)]
    lines.append(_champions(runs, is_written_back=counts.written_back > 0))
    if explored := sum(run.summary.explored for run in runs):
        seconds = np.mean([run.summary.explore_seconds for run in runs])
        lines.append(
            f"* Besides, {explored:,} trees were refined in exploring from the hall of fame, "
            f"{explored / len(runs):,.0f} a run in {seconds:.1f} s."
        )
    if counts.skipped:
        were = "was" if counts.skipped == 1 else "were"
        lines.append(f"* {counts.skipped:,} more {were} skipped, as no tree could be a candidate.")
    if published := _published(runs):
        lines.append(f"* Thesis: {published.refinements_in_words}.")
    return f"{table}\n\n" + "\n".join(lines)


def comparison_text(pairs: Sequence[Pair], solved_at: float, rng: np.random.Generator) -> str:
    """Return what a method and GE alone take to reach the threshold, seed by seed: generations and steps.

    Args:
        pairs: Pairs of one environment and method, at least one.
        solved_at: The threshold.
        rng: Draws the resamples of the intervals.
    """
    method = pairs[0].method
    refiner = refiner_of(method)
    times = [(refined.solving_time(solved_at), plain.solving_time(solved_at)) for refined, plain in pairs]
    ratio = paired_ratio(times, rng)
    steps = paired_ratio(times, rng, measure=env_steps_of)
    n = len(pairs)
    lines = [
        (
            f"* Median ratio of generations: {_interval(ratio.median, ratio.interval, n)}. "
            f"By the median, {method} is {_direction(ratio, 'faster', 'slower', 'as fast')}."
        ),
        (
            f"* Median ratio of environment steps, those of refinement included: "
            f"{_interval(steps.median, steps.interval, n)}. "
            f"By the median, {method} takes {_direction(steps, 'fewer', 'more', 'as many')}."
        ),
        (
            f"* Never reached: {ratio.treated_censored} of {n} with {refiner}, {ratio.control_censored} of {n} "
            f"without, {ratio.both_censored} in both. Such a run counts as all that it took, a lower bound."
        ),
        f"* {_whole_runs(pairs)}.",
    ]
    if sections := unequal_sections(pairs):
        lines.append(f"* Mind that the runs of a pair differ in more than refinement: {', '.join(sections)}.")
    return f"{_comparison_table(pairs, times)}\n\n" + "\n".join(lines)


def _comparison_table(pairs: Sequence[Pair], times: Sequence[tuple[SolvingTime, SolvingTime]]) -> str:
    def row(seed: int, treated: SolvingTime, control: SolvingTime) -> list[str]:
        generations, steps = (
            [
                _took(treated, measure(treated)),
                _took(control, measure(control)),
                f"{measure(treated) / measure(control):.2f}",
            ]
            for measure in (generations_of, env_steps_of)
        )
        return [str(seed), *generations, *steps]

    method = pairs[0].method
    head = ["seed", method, "GE alone", "ratio", f"env steps, {method}", "GE alone", "ratio"]
    return markdown(head, [row(pair.refined.seed, *both) for pair, both in zip(pairs, times, strict=True)])


def _took(time: SolvingTime, number: int) -> str:
    return f"> {number:,}" if time.censored else f"{number:,}"


def _published(runs: Sequence[Run]) -> PublishedSweep | None:
    """Return the thesis' runs to stand beside these; it has runs of GE+PPO alone."""
    return PUBLISHED.get(runs[0].environment) if runs[0].method == GE_PPO else None


def _source(table: str) -> str:
    return (
        f"Thesis: Table {table}. A seed does not make the same run in two programs: compare columns, not "
        "rows. The thesis' means are of all its runs."
    )


def _solved(runs: Sequence[Run]) -> str:
    if runs[0].summary.solved_at is None:
        return ""
    solved, n = sum(bool(run.summary.solved) for run in runs), len(runs)
    low, high = wilson_interval(solved, n)
    return f"{solved} of {n} ({low:.0%} to {high:.0%})"


def _mean(values: Sequence[float], rng: np.random.Generator) -> str:
    return _interval(float(np.mean(values)), bootstrap_interval(values, rng), len(values))


def _interval(value: float, interval: Interval, n: int) -> str:
    return f"{value:.2f}" if n == 1 else f"{value:.2f} ({interval.low:.2f} to {interval.high:.2f})"


def _gap(trained: Sequence[float], tested: Sequence[float]) -> str:
    gap = float(np.mean(trained) - np.mean(tested))
    return f"{abs(gap):.2f} {'above' if gap >= 0 else 'below'} it on average"


def _direction(ratio: PairedRatio, less: str, more: str, same: str) -> str:
    """Return in which direction a ratio points, and whether that is in doubt."""
    direction = less if ratio.median < 1 else more if ratio.median > 1 else same
    if ratio.pairs == 1:
        return f"{direction}, but one pair shows little"
    is_undecided = ratio.median != 1 and ratio.interval.low <= 1 <= ratio.interval.high
    return f"{direction}, but the interval does not exclude 1" if is_undecided else direction


def _bridges(bridges: Bridges) -> str:
    hardening = ""
    if bridges.soft is not None and bridges.lost_in_hardening is not None:
        hardening = (
            f"{bridges.lost_in_hardening:.2f} in hardening (soft {bridges.soft:.2f} -> {bridges.after:.2f}), "
        )
    return (
        f"* Mean loss of each bridge, of the {_number(bridges.applications, 'tree')} with all returns known: "
        f"{hardening}{bridges.lost_in_snapping:.2f} in snapping to the grammar's constants "
        f"({bridges.after:.2f} -> {bridges.snapped:.2f}). Before, they returned {bridges.before:.2f}."
    )


def _champions(runs: Sequence[Run], *, is_written_back: bool) -> str:
    origins = Counter(run.summary.champion_from for run in runs)
    explored = ""
    if any(run.summary.explored for run in runs):
        explored = f", and a tree refined in exploring in {origins['neighbour']}"
    caveat = " A tree that was written back counts as one of the population." if is_written_back else ""
    return (
        f"* The champion is a refined tree in {origins['refinement']} of {_number(len(runs), 'run')}"
        f"{explored}.{caveat}"
    )


def _whole_runs(pairs: Sequence[Pair]) -> str:
    refiner = refiner_of(pairs[0].method)
    sampled = np.mean([count_refinements(refined.refinements).timesteps for refined, _ in pairs])
    treated, alone = (np.mean([run.summary.env_steps for run in runs]) for runs in zip(*pairs, strict=True))
    explored = np.mean([refined.summary.explored for refined, _ in pairs])
    exploring = f" and others in refining {explored:,.0f} trees of its hall of fame" if explored else ""
    return (
        f"In environment steps, a whole run took {treated:,.0f} with {refiner}, {sampled:,.0f} of them in refining "
        f"trees of its population{exploring}, and {alone:,.0f} without"
    )


def _number(n: int, what: str) -> str:
    return f"{n} {what}{'' if n == 1 else 's'}"
