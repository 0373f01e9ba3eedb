"""What many runs show, in words and tables of Markdown that are computed from them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np

from ge_torchrl.report.published import PUBLISHED
from ge_torchrl.report.refinements import count_refinements
from ge_torchrl.report.runs import GE, GE_PPO, Pair, Run, unequal_sections
from ge_torchrl.report.statistics import (
    Interval,
    PairedRatio,
    bootstrap_interval,
    paired_ratio,
    wilson_interval,
)
from ge_torchrl.report.tables import markdown, published_summary, runs_table, thesis_table


def runs_tables(runs: Sequence[Run]) -> str:
    """Return tables of all runs with their sizes and times, by method where there are several.

    Args:
        runs: Runs in any order.
    """
    methods = [method for method in (GE_PPO, GE) if any(run.method == method for run in runs)]
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
    rows = []
    for (environment, method), group in groupby(runs, key=lambda run: (run.environment, run.method)):
        members = list(group)
        published = PUBLISHED.get(environment)
        thesis = ["", "", ""] if published is None or method != GE_PPO else published_summary(published)
        ours = [
            _solved(members),
            f"{np.mean([run.summary.test_mean for run in members]):.2f}",
            f"{np.mean([run.summary.complexity_M for run in members]):.1f}",
        ]
        both = [cell for pair in zip(ours, thesis, strict=True) for cell in pair]
        rows.append([f"{environment} {method}", str(len(members)), *both])
    head = ["method", "runs", "solved", "thesis", "mean test return", "thesis", "mean M", "thesis"]
    return markdown(head, rows)


def method_text(runs: Sequence[Run], rng: np.random.Generator) -> str:
    """Return the table of runs, the thesis' numbers beside ours, and what the table shows.

    Args:
        runs: Runs of one environment and method.
        rng: Draws the resamples of intervals.
    """
    published = PUBLISHED.get(runs[0].environment)
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
    source = "" if published is None else f"\n\n{_source(published.table, runs[0].method)}"
    return f"{table}{source}\n\n" + "\n".join(lines)


def refinements_text(runs: Sequence[Run]) -> str:
    """Return how many applications of PPO improved a tree, by both ways of counting.

    Args:
        runs: Runs of GE+PPO in one environment.
    """
    counts = count_refinements(record for run in runs for record in run.refinements)
    rows = {
        "return after > fitness before, as the thesis counts": counts.beyond_fitness,
        "return after > return before, on the same unseen episodes": counts.beyond_return,
        "best of its generation": counts.new_best,
        "some threshold moved": counts.moved_thresholds,
        "some leaf changed its action": counts.changed_leaves,
        "training broke off": counts.failed,
    }
    table = markdown(
        ["applications of PPO", f"of {counts.applied}"], [[what, str(n)] for what, n in rows.items()]
    )
    lines = [f"* The champion is a refined tree in {_champions(runs)} of {_number(len(runs), 'run')}."]
    if counts.skipped:
        lines.append(f"* In {_number(counts.skipped, 'more generation')} no tree could be a candidate.")
    if published := PUBLISHED.get(runs[0].environment):
        lines.append(f"* Thesis: {published.refinements_in_words}.")
    return f"{table}\n\n" + "\n".join(lines)


def comparison_text(pairs: Sequence[Pair], solved_at: float, rng: np.random.Generator) -> str:
    """Return how many generations GE+PPO and GE alone take to reach the threshold, seed by seed.

    Args:
        pairs: Pairs of one environment, at least one.
        solved_at: The threshold.
        rng: Draws the resamples of the interval.
    """
    times = [(refined.solving_time(solved_at), plain.solving_time(solved_at)) for refined, plain in pairs]
    rows = []
    for (refined, _), (treated, control) in zip(pairs, times, strict=True):
        cells = [
            f"> {time.generations}" if time.censored else str(time.generations) for time in (treated, control)
        ]
        rows.append([str(refined.seed), *cells, f"{treated.generations / control.generations:.2f}"])
    ratio = paired_ratio(times, rng)
    direction = "faster" if ratio.median < 1 else "slower" if ratio.median > 1 else "as fast"
    n = len(pairs)
    lines = [
        (
            f"* Median ratio: {_interval(ratio.median, ratio.interval, n)}. "
            f"By the median, GE+PPO is {direction}{_doubt(ratio)}."
        ),
        (
            f"* Never reached: {ratio.treated_censored} of {n} with PPO, {ratio.control_censored} of {n} without, "
            f"{ratio.both_censored} in both. Such a run counts as the generations that it ran, a lower bound."
        ),
        f"* Generations leave out what PPO samples itself. {_samples(pairs)}.",
    ]
    if sections := unequal_sections(pairs):
        lines.append(f"* Mind that the runs of a pair differ in more than PPO: {', '.join(sections)}.")
    table = markdown(["seed", "GE+PPO", "GE alone", "ratio"], rows)
    return f"{table}\n\n" + "\n".join(lines)


def _source(table: str, method: str) -> str:
    other = "" if method == GE_PPO else "The thesis' runs are of GE+PPO, these of GE alone. "
    return (
        f"Thesis: Table {table}. {other}A seed does not make the same run in two programs: compare columns, not "
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


def _doubt(ratio: PairedRatio) -> str:
    if ratio.pairs == 1:
        return ", but one pair shows little"
    undecided = ratio.median != 1 and ratio.interval.low <= 1 <= ratio.interval.high
    return ", but the interval does not exclude 1" if undecided else ""


def _champions(runs: Sequence[Run]) -> int:
    return sum(run.summary.champion_from == "refinement" for run in runs)


def _samples(pairs: Sequence[Pair]) -> str:
    sampled = np.mean([count_refinements(refined.refinements).timesteps for refined, _ in pairs])
    with_ppo, alone = (np.mean([run.summary.env_steps for run in runs]) for runs in zip(*pairs, strict=True))
    return (
        f"In environment steps, a run took {with_ppo:,.0f} with PPO, {sampled:,.0f} of them sampled by it, and "
        f"{alone:,.0f} without"
    )


def _number(n: int, what: str) -> str:
    return f"{n} {what}{'' if n == 1 else 's'}"
