"""The tables of small rules, of weighted sums and of actions that are numbers; `results.py` writes them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.report.evaluation import evaluate
from ge_torchrl.report.runs import read_runs
from ge_torchrl.report.tables import Table
from ge_torchrl.trees.text import render_text

_FIRST_SEED = 1_000_000


class Row(NamedTuple):
    """What a row of the table is of.

    Attributes:
        folder: Of the runs.
        kind: What the trees say.
        goal: The return to reach.
        most: With so many decision nodes at most.
        episodes: Unseen episodes of each tree.
        published: Returns of deep RL.
    """

    folder: str
    kind: str
    goal: float
    most: int
    episodes: int
    published: str


# What the median of ten seeds is to reach, and what agents of the stable-baselines3 zoo return, as its page says.
RULES = (
    Row("pendulum", "linear laws", -150.0, 2, 10_000, "PPO -172.2, TD3 -151.9"),
    Row("mountaincar_continuous", "linear laws", 98.5, 2, 10_000, "PPO 88.3, ARS 96.7"),
    Row("lunarlander", "weighted sums", 265.0, 5, 1000, "DQN 154, PPO 242.1"),
    Row("lunarlander_axis", "one feature a split", 180.0, 19, 1000, "DQN 154, PPO 242.1"),
    Row("acrobot", "weighted sums, 1 split", -77.5, 1, 10_000, "QR-DQN -69.1"),
    Row("acrobot", "weighted sums, 2 splits", -74.5, 2, 10_000, "QR-DQN -69.1"),
    Row("acrobot", "weighted sums, 6 splits", -69.1, 6, 10_000, "QR-DQN -69.1"),
    Row("flappybird", "weighted sums", 250.0, 2, 200, ""),
)


def rules_tables(folder: Path, _figures: Path) -> Iterator[tuple[str, str]]:
    """Small rules: each run's best tree in its own validation among those that are small enough, on unseen episodes."""
    head = (
        "task",
        "deep RL, published",
        "to reach",
        "median run",
        "worst run",
        "best run",
        "runs that reach it",
        "decision nodes",
        "PPO refined, bettered",
        "seconds a run, median",
    )
    rows, texts = [], []
    shown: set[str] = set()
    for name, kind, goal, most, episodes, published in RULES:
        if not (folder / "rules" / name).exists():
            continue
        runs = read_runs(folder / "rules" / name).runs
        sizes = [
            max(
                (tree for tree in run.by_size if tree.decision_nodes <= most), key=lambda t: t.validation_mean
            )
            for run in runs
        ]
        found = [
            evaluate(run.path, episodes, _FIRST_SEED, nodes=tree.decision_nodes)
            for run, tree in zip(runs, sizes, strict=True)
        ]
        means = [one.mean for one in found]
        title = f"{runs[0].environment}, {kind}"
        refined = [record for run in runs for record in run.refinements if record.outcome != "skipped"]
        rows.append(
            [
                title,
                published,
                f"{goal:g} with {most} or fewer",
                *(f"{value:.2f}" for value in (np.median(means), min(means), max(means))),
                f"{sum(mean >= goal for mean in means)} of {len(means)}",
                ", ".join(str(one.decision_nodes) for one in found),
                f"{len(refined)}, {sum(record.outcome == 'improved' for record in refined)}",
                f"{np.median([run.summary.wall_seconds for run in runs]):.0f}",
            ]
        )
        if name in shown:
            continue
        shown.add(name)
        # Of an even number the lower one of the two in the middle.
        middle = int(np.argsort(means)[(len(means) - 1) // 2])
        rule = RunFolder(runs[middle].path).read_archive_tree(found[middle].decision_nodes)
        mean, std = found[middle].mean, found[middle].std
        texts.append(
            f"{title}, seed {runs[middle].seed}: {mean:.2f} ± {std:.2f} over {episodes:,} episodes\n\n"
            f"```\n{render_text(rule.tree, rule.names)}\n```"
        )
    table = Table.of(head, rows)
    yield "rules", "\n\n".join([table.markdown(), *texts])
    titles = ("to reach", "runs that reach it", "PPO refined, bettered", "seconds a run, median")
    # Beside deep RL stand the tasks for which deep RL was published.
    beside = Table.of(head, [row for row in rows if row[1]])
    yield "rules-summary", without(beside, *titles).markdown()


def without(table: Table, *titles: str) -> Table:
    """Return a table without some of its columns."""
    kept = [n for n, title in enumerate(table.head) if title not in titles]
    return Table.of((table.head[n] for n in kept), ((row[n] for n in kept) for row in table.rows))
