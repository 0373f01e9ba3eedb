"""What the trees of many runs did on the same test episodes, in tables: run by run, and size by size."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ge_torchrl.report.tables import aligned, markdown

_BY_SIZE = (
    'By size. "Best in validation" did best of all runs on as many other episodes, the same for all.\n'
    '"Best of runs" is chosen by this test itself, so its mean flatters.'
)


@dataclass(frozen=True)
class EvaluatedTree:
    """One tree on the test episodes.

    Attributes:
        decision_nodes: Its size.
        mean: Its mean return.
        std: Standard deviation of its returns.
    """

    decision_nodes: int
    mean: float
    std: float


@dataclass(frozen=True)
class ValidatedTree(EvaluatedTree):
    """One tree of a hall of fame, beside those of other runs.

    Attributes:
        validation_mean: Its mean return on validation episodes, the same for all runs, which choose among them.
    """

    validation_mean: float


@dataclass(frozen=True)
class EvaluatedRun:
    """The trees of one run.

    Attributes:
        path: Its folder.
        seed: Its seed.
        wall_seconds: Clock time of the run.
        chosen: Its champion, or its tree of the size that was asked for.
        by_size: Its best tree of each size, from small to large; none where it kept no hall of fame.
    """

    path: str
    seed: int
    wall_seconds: float
    chosen: EvaluatedTree
    by_size: tuple[ValidatedTree, ...]


@dataclass(frozen=True)
class EvaluatedSize:
    """The trees of one size.

    Attributes:
        decision_nodes: The size.
        runs: Runs that have a tree of it.
        median: Median over runs of the trees' mean returns.
        in_validation: Mean return of the tree that did best on the validation episodes.
        in_validation_seed: The seed of its run.
        best_of_runs: The best mean return of all runs, chosen by the test itself.
        best_of_runs_seed: The seed of its run.
    """

    decision_nodes: int
    runs: int
    median: float
    in_validation: float
    in_validation_seed: int
    best_of_runs: float
    best_of_runs_seed: int

    def as_dict(self) -> Mapping[str, object]:
        """Return plain values for JSON."""
        return dict(vars(self))


@dataclass(frozen=True)
class EvaluatedMethod:
    """All runs of one environment and method.

    Attributes:
        environment: Gymnasium id.
        method: Such as "GE+PPO".
        max_episode_steps: Limit of an episode's length.
        solved_at: The threshold, or None.
        route: "compiled" or "gymnasium".
        runs: Its runs in the order of their seeds, at least one.
    """

    environment: str
    method: str
    max_episode_steps: int
    solved_at: float | None
    route: str
    runs: tuple[EvaluatedRun, ...]

    @property
    def means(self) -> tuple[float, ...]:
        """The mean return of the tree of each run."""
        return tuple(run.chosen.mean for run in self.runs)

    @property
    def solved(self) -> int | None:
        """Runs whose tree solves the task; None where there is no threshold."""
        return None if self.solved_at is None else sum(mean >= self.solved_at for mean in self.means)

    @property
    def sizes(self) -> list[EvaluatedSize]:
        """What the trees of each size do, from small to large."""
        trees = [(run.seed, tree) for run in self.runs for tree in run.by_size]
        rows = []
        for size in sorted({tree.decision_nodes for _, tree in trees}):
            found = [(seed, tree) for seed, tree in trees if tree.decision_nodes == size]
            validated_seed, validated = max(found, key=lambda pair: pair[1].validation_mean)
            best_seed, best = max(found, key=lambda pair: pair[1].mean)
            median = float(np.median([tree.mean for _, tree in found]))
            rows.append(
                EvaluatedSize(size, len(found), median, validated.mean, validated_seed, best.mean, best_seed)
            )
        return rows

    def as_dict(self) -> Mapping[str, object]:
        """Return plain values for JSON."""
        runs = [
            {
                "path": run.path,
                "seed": run.seed,
                "wall_seconds": run.wall_seconds,
                **vars(run.chosen),
                "solved": self._is_solved(run),
                "by_size": [dict(vars(tree)) for tree in run.by_size],
            }
            for run in self.runs
        ]
        return {
            **vars(self),
            "solved": self.solved,
            "worst_mean": min(self.means),
            "median_mean": float(np.median(self.means)),
            "runs": runs,
            "sizes": [row.as_dict() for row in self.sizes],
        }

    def runs_rows(self) -> tuple[list[str], list[list[str]]]:
        """Return head and rows of a table, a row a run."""
        head = ["seed", "decision nodes", "test mean ± sd", "solved", "run s"]
        verdicts = {None: "", True: "yes", False: "no"}
        rows = [
            [
                str(run.seed),
                str(run.chosen.decision_nodes),
                f"{run.chosen.mean:.2f} ± {run.chosen.std:.2f}",
                verdicts[self._is_solved(run)],
                f"{run.wall_seconds:.1f}",
            ]
            for run in self.runs
        ]
        return head, rows

    def sizes_rows(self) -> tuple[list[str], list[list[str]]]:
        """Return head and rows of a table, a row a size; no row where no run kept a hall of fame."""
        head = ["decision nodes", "runs", "median"]
        head += ["best in validation", "its seed", "best of runs (chosen by this test)", "its seed"]
        rows = [
            [
                str(row.decision_nodes),
                str(row.runs),
                f"{row.median:.2f}",
                f"{row.in_validation:.2f}",
                str(row.in_validation_seed),
                f"{row.best_of_runs:.2f}",
                str(row.best_of_runs_seed),
            ]
            for row in self.sizes
        ]
        return head, rows

    def in_short(self) -> str:
        """Return one line over all runs."""
        means = f"worst seed mean {min(self.means):.2f}, median seed mean {np.median(self.means):.2f}"
        told = means if self.solved is None else f"solved {self.solved} of {len(self.runs)}, {means}"
        repeats = len({run.seed for run in self.runs}) < len(self.runs)
        return f"{told}; some seeds stand more than once" if repeats else told

    def _is_solved(self, run: EvaluatedRun) -> bool | None:
        return None if self.solved_at is None else run.chosen.mean >= self.solved_at


@dataclass(frozen=True)
class SweepEvaluation:
    """The trees of many runs, all of an environment on the same test episodes.

    Attributes:
        episodes: Number of episodes.
        seed: Episode `i` began with `reset(seed=seed + i)`.
        methods: For each environment and method its runs.
        left_out: For every run that is not among them one line that names it and says why.
    """

    episodes: int
    seed: int
    methods: tuple[EvaluatedMethod, ...]
    left_out: tuple[str, ...]

    def as_dict(self) -> Mapping[str, object]:
        """Return plain values for JSON."""
        return {
            "episodes": self.episodes,
            "seed": self.seed,
            "methods": [method.as_dict() for method in self.methods],
            "left_out": list(self.left_out),
        }

    def as_text(self) -> str:
        """Return tables for a terminal."""
        return self._told(aligned, "{}", "{}")

    def as_markdown(self) -> str:
        """Return tables in Markdown."""
        return self._told(markdown, "**{}**", "* {}.")

    def _told(
        self, table: Callable[[Sequence[str], Sequence[Sequence[str]]], str], title: str, line: str
    ) -> str:
        last = self.seed + self.episodes - 1
        parts = []
        for method in self.methods:
            threshold = "" if method.solved_at is None else f", solved from {method.solved_at:g}"
            episodes = f"{self.episodes:,} episodes, seeds {self.seed} to {last}"
            name = title.format(f"{method.environment} {method.method}")
            parts.append(f"{name} ({episodes}, {method.route} route{threshold})")
            parts += [table(*method.runs_rows()), line.format(method.in_short())]
            head, rows = method.sizes_rows()
            if rows:
                parts += [_BY_SIZE, table(head, rows)]
        return "\n\n".join(parts)
