"""How right the time left is that runs tell from half-way on, replayed from what they left.

python tests/benchmarks/time_left.py FOLDER...

For each kind of run: how many reports there were after half of its time, in which part of them the estimate was off by
more than a third of the true rest (and by more than two seconds), and by what factor the median one was. What follows
the search is estimated from the archive that the run ended with, and from the speed of its validation and test: a
folder does not say what was kept before, and how fast that was measured.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

from ge_torchrl.artefacts.folder import RunFolder, find_runs
from ge_torchrl.artefacts.records import GenerationRecord, Summary
from ge_torchrl.config import Config
from ge_torchrl.report.reading import environment_of_tree
from ge_torchrl.run.allowance import Allowance, Phase
from ge_torchrl.run.costs import refinement_cost
from ge_torchrl.run.remaining import Estimate, after_search
from ge_torchrl.search.archive import ARCHIVE
from ge_torchrl.search.conclusion import TEST, VALIDATION

# An estimate is right within a third of the true rest, or within so many seconds.
_PART, _SECONDS = 1 / 3, 2.0


class Report(NamedTuple):
    """What a run told after a generation, and what was true.

    Attributes:
        elapsed: Seconds that the run had taken by then.
        told: Seconds left that it told.
        true: Seconds that were left.
        after: Those of them that it expected after the search.
        true_after: Those that the end took.
    """

    elapsed: float
    told: float
    true: float
    after: float
    true_after: float

    @property
    def is_off(self) -> bool:
        """Whether it was not right within a third."""
        return abs(self.told - self.true) > max(_PART * self.true, _SECONDS)


def replay(folder: RunFolder) -> list[Report]:
    """Return what a finished run told after each generation."""
    config, summary, history = folder.read_config(), folder.read_summary(), folder.read_history()
    spec = environment_of_tree(folder.read_best_tree(), config.env)
    longest = spec.max_episode_steps
    rounds = "rounding" in summary.steps
    share = Allowance.of(config, 0.0, longest, rounds=rounds).ends[Phase.SEARCH]
    estimate = Estimate(config, share, refinement_cost(config, longest))
    nodes = [record.decision_nodes for record in folder.read_archive()] if config.archive.enabled else []
    reports = []
    for record in history:
        after = _after(config, summary, record, nodes, longest, rounds=rounds)
        told = estimate.seconds_left(record, after)
        true = summary.wall_seconds - record.elapsed_seconds
        true_after = summary.wall_seconds - history[-1].elapsed_seconds
        reports.append(Report(record.elapsed_seconds, told, true, after, true_after))
    return reports


def _after(
    config: Config,
    summary: Summary,
    record: GenerationRecord,
    nodes: list[int],
    longest: int,
    *,
    rounds: bool,
) -> float:
    """Return what a run expects of its end, as far as its folder knows what it knew."""
    kept = [SimpleNamespace(tree=SimpleNamespace(num_decision_nodes=n)) for n in nodes] * config.archive.keep
    evaluation = config.evaluation
    measured = (len(kept) + 2) * evaluation.validation_episodes
    length = min(longest, summary.steps[VALIDATION] / measured)
    seconds = summary.wall_seconds - summary.evolve_seconds
    steps = summary.steps[VALIDATION] + summary.steps[TEST]
    problem = SimpleNamespace(
        config=config,
        backend=SimpleNamespace(
            name=summary.route,
            steps_per_second=evaluation.steps_per_second,
            steps={ARCHIVE: length * config.archive.episodes / 2},
            ledger=SimpleNamespace(timed={ARCHIVE: (steps, seconds)}),
            spec=SimpleNamespace(max_episode_steps=longest),
        ),
        refines=config.refiner.enabled or config.polish.enabled,
        polisher=True if config.polish.enabled else None,
        rounds=rounds,
    )
    state = SimpleNamespace(archive=SimpleNamespace(members=kept, offered=[None]), counts=record)
    refine_seconds = summary.refine_seconds * record.refined / max(1, summary.refined)
    return after_search(cast("Any", problem), cast("Any", state), refine_seconds)


def late(reports: list[Report]) -> Iterator[Report]:
    """Yield the reports after half of a run's time."""
    for report in reports:
        if report.elapsed >= report.true:
            yield report


def main() -> None:
    """Print a row for each kind of run below the folders."""
    kinds: dict[str, list[list[Report]]] = defaultdict(list)
    for given in map(Path, sys.argv[1:]):
        for folder in find_runs(given):
            config = folder.read_config()
            limit = (
                "seconds" if config.ge.max_seconds else "steps" if config.ge.max_env_steps else "generations"
            )
            name = f"{config.env.id.split(':')[-1]}, {config.refiner.method}, {limit}"
            try:
                kinds[f"{given.name}: {name}"].append(replay(folder))
            except Exception as error:  # noqa: BLE001 - a run of another version says nothing here.
                print(f"{folder}: {' '.join(str(error).split())}", file=sys.stderr)
    print(f"{'kind':60}  runs  reports  off by a third  told/true  after told/true")
    for kind, runs in sorted(kinds.items()):
        reports = [report for run in runs for report in late(run)]
        if not reports:
            print(f"{kind:60}  {len(runs):4}        0")
            continue
        off = sum(report.is_off for report in reports) / len(reports)
        factor = median(report.told / max(report.true, 1e-9) for report in reports)
        after = median(report.after / max(report.true_after, 1e-9) for report in reports)
        print(f"{kind:60}  {len(runs):4}  {len(reports):7}  {off:14.0%}  {factor:9.2f}  {after:15.2f}")


if __name__ == "__main__":
    main()
