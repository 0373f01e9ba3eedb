"""The thesis' question, seed by seed: does refinement save generations, and steps, against GE alone?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ge_torchrl.report.findings import interval_text
from ge_torchrl.report.methods import GE, added_by
from ge_torchrl.report.runs import Run
from ge_torchrl.report.statistics import FEW
from ge_torchrl.report.tables import Table
from ge_torchrl.report.thesis.solving import (
    PairedRatio,
    SolvingTime,
    env_steps_of,
    generations_of,
    paired_ratio,
    solving_time,
)

# What is added to GE differs by intention, and what only costs time or is measured differs from run to run.
_ADDED_SECTIONS = {"refiner", "polish", "archive", "seed", "logger"}
_WITHOUT_EFFECT = {"threads", "workers", "steps_per_second"}
# The thesis' figure 4.2 shows as many.
_SHOWN_PAIRS = 3


class Pair(NamedTuple):
    """Two runs of one environment and seed.

    Attributes:
        treated: The run of a method that adds something to GE.
        plain: The run of GE alone.
    """

    treated: Run
    plain: Run

    @property
    def method(self) -> str:
        """The method of the treated run."""
        return self.treated.method

    def solving_times(self, threshold: float) -> tuple[SolvingTime, SolvingTime]:
        """Return when either run reached a threshold, the treated one first."""
        return solving_time(self.treated.history, threshold), solving_time(self.plain.history, threshold)


def pair_by_seed(runs: Sequence[Run], method: str) -> tuple[Pair, ...]:
    """Return for every seed with a run of a method and one of GE alone that pair.

    Of several runs of a seed the first is taken, and of its controls the one whose settings are most alike.

    Args:
        runs: Runs of one environment.
        method: The method that adds something to GE.
    """
    treated: dict[int, Run] = {}
    controls: dict[int, list[Run]] = {}
    for run in runs:
        if run.method == method:
            treated.setdefault(run.seed, run)
        elif run.method == GE:
            controls.setdefault(run.seed, []).append(run)
    return tuple(
        Pair(run, min(controls[seed], key=lambda plain: len(_differing(run, plain))))
        for seed, run in sorted(treated.items())
        if seed in controls
    )


def unequal_sections(pairs: Sequence[Pair]) -> tuple[str, ...]:
    """Return the sections of the configuration, beside what is added to GE, in which the runs of some pair differ."""
    return tuple(sorted({section for pair in pairs for section in _differing(*pair)}))


def telling_pairs(pairs: Sequence[Pair], solved_at: float) -> list[Pair]:
    """Return the few pairs in which the treatment saved most generations, in the order of their seeds."""

    def saved(pair: Pair) -> int:
        treated, plain = pair.solving_times(solved_at)
        return plain.generations - treated.generations

    most = sorted(pairs, key=saved, reverse=True)[:_SHOWN_PAIRS]
    return sorted(most, key=lambda pair: pair.treated.seed)


def comparison_text(pairs: Sequence[Pair], solved_at: float, rng: np.random.Generator) -> str:
    """Return what a method and GE alone take to reach the threshold, seed by seed: generations and steps.

    Args:
        pairs: Pairs of one environment and method, at least one.
        solved_at: The threshold.
        rng: Draws the resamples of the intervals.
    """
    method, n = pairs[0].method, len(pairs)
    times = [pair.solving_times(solved_at) for pair in pairs]
    ratio = paired_ratio(times, rng)
    steps = paired_ratio(times, rng, measure=env_steps_of)
    lines = [
        (
            f"* Median ratio of generations: {interval_text(ratio.median, ratio.interval, n)}. "
            f"By the median, {method} is {_direction(ratio, 'faster', 'slower', 'as fast')}."
        ),
        (
            f"* Median ratio of environment steps, those of refinement included: "
            f"{interval_text(steps.median, steps.interval, n)}. "
            f"By the median, {method} takes {_direction(steps, 'fewer', 'more', 'as many')}."
        ),
        (
            f"* Never reached: {ratio.treated_censored} of {n} with {added_by(method)}, {ratio.control_censored} of "
            f"{n} without, {ratio.both_censored} in both. Such a run counts as all that it took, a lower bound."
        ),
        f"* {_whole_runs(pairs)}.",
    ]
    if sections := unequal_sections(pairs):
        lines.append(f"* Mind that the runs of a pair differ in more than that: {', '.join(sections)}.")
    return f"{_table(pairs, times).markdown()}\n\n" + "\n".join(lines)


def _table(pairs: Sequence[Pair], times: Sequence[tuple[SolvingTime, SolvingTime]]) -> Table:
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
    head = ("seed", method, "GE alone", "ratio", f"env steps, {method}", "GE alone", "ratio")
    return Table.of(head, (row(pair.treated.seed, *both) for pair, both in zip(pairs, times, strict=True)))


def _took(time: SolvingTime, number: int) -> str:
    return f"> {number:,}" if time.censored else f"{number:,}"


def _direction(ratio: PairedRatio, less: str, more: str, same: str) -> str:
    """Return in which direction a ratio points, and whether that is in doubt."""
    direction = less if ratio.median < 1 else more if ratio.median > 1 else same
    if ratio.pairs == 1:
        return f"{direction}, but one pair shows little"
    if ratio.pairs < FEW:
        return f"{direction}, but {ratio.pairs} pairs show little"
    is_undecided = ratio.median != 1 and ratio.interval.low <= 1 <= ratio.interval.high
    return f"{direction}, but the interval does not exclude 1" if is_undecided else direction


def _whole_runs(pairs: Sequence[Pair]) -> str:
    treated, alone = (np.mean([run.summary.env_steps for run in runs]) for runs in zip(*pairs, strict=True))
    spent = {
        purpose: np.mean([pair.treated.summary.steps.get(purpose, 0) for pair in pairs])
        for purpose in ("refinement", "polish")
    }
    shares = [f"{steps:,.0f} of them in {purpose}, " for purpose, steps in spent.items() if steps]
    return (
        f"In environment steps, a whole search took {treated:,.0f} with {added_by(pairs[0].method)}, "
        f"{''.join(shares)}and {alone:,.0f} without"
    )


def _differing(treated: Run, plain: Run) -> set[str]:
    ours, theirs = treated.config.as_mapping(), plain.config.as_mapping()
    return {
        section
        for section in ours.keys() - _ADDED_SECTIONS
        if _with_effect(ours[section]) != _with_effect(theirs[section])
    }


def _with_effect(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name not in _WITHOUT_EFFECT}
