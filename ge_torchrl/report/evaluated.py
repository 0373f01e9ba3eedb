"""What trees did on new test episodes: one tree in words, the trees of many runs in tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from ge_torchrl.printing import in_markdown
from ge_torchrl.report.methods import refiner_of
from ge_torchrl.report.sizes import SizedTree, SizeRow, are_of_one_run, by_size, sizes_table
from ge_torchrl.report.tables import Form, RunRow, counted, runs_table

_BY_SIZE = (
    'By size. "Best in validation" did best of all runs on as many other episodes, the same for all.\n'
    '"Best of runs" is chosen by this test itself, so its mean flatters.'
)


@dataclass(frozen=True)
class EvaluationSummary:
    """What a tree did on test episodes.

    Attributes:
        environment: Gymnasium id.
        mean: Mean return.
        std: Standard deviation of the returns.
        min: Lowest return.
        max: Highest return.
        episodes: Number of episodes.
        seed: Episode `i` began with `reset(seed=seed + i)`.
        solved: Whether the mean reaches the threshold; None where there is none.
        solved_at: The threshold, or None.
        route: "kernel" or "gymnasium".
        decision_nodes: Of the tree.
    """

    environment: str
    mean: float
    std: float
    min: float
    max: float
    episodes: int
    seed: int
    solved: bool | None
    solved_at: float | None
    route: str
    decision_nodes: int

    def as_dict(self) -> Mapping[str, object]:
        """Return plain values for JSON."""
        return asdict(self)

    def as_text(self) -> str:
        """Return the lines for a person."""
        last = self.seed + self.episodes - 1
        return (
            f"{self.environment}: mean return {self.mean:.3f} ± {self.std:.3f} "
            f"(min {self.min:g}, max {self.max:g}) over {counted(self.episodes, 'episode')}\n"
            f"seeds {self.seed} to {last}, {self.route} route, {counted(self.decision_nodes, 'decision node')}\n"
            f"{verdict(self.solved, self.solved_at)}"
        )


def verdict(solved: bool | None, solved_at: float | None) -> str:
    """Return whether the task is solved, in words."""
    if solved is None or solved_at is None:
        return "no threshold is agreed on for this environment"
    return f"{'SOLVED' if solved else 'not solved'}: the threshold is a mean return of {solved_at:g}"


@dataclass(frozen=True)
class EvaluatedRun:
    """The trees of one run.

    Attributes:
        path: Its folder.
        row: What the test said of its champion, or of its tree of the size that was asked for.
        by_size: Its best tree of each size, from small to large; none where it kept no archive.
        refined: How many trees its refiner refined; None where that is not known.
    """

    path: str
    row: RunRow
    by_size: tuple[SizedTree, ...]
    refined: int | None = None

    def as_dict(self) -> Mapping[str, object]:
        """Return plain values for JSON."""
        row = {
            name: value for name, value in asdict(self.row).items() if value is not None or name == "solved"
        }
        return {"path": self.path, **row, "by_size": [asdict(tree) for tree in self.by_size]}


@dataclass(frozen=True)
class EvaluatedMethod:
    """All runs of one environment, method and setting.

    Attributes:
        environment: Gymnasium id, with arguments, wrappers and limit where there are any.
        method: Such as "GE+PPO".
        max_episode_steps: Limit of an episode's length.
        solved_at: The threshold, or None.
        route: "kernel" or "gymnasium".
        runs: Its runs in the order of their seeds, at least one.
        setting: What other runs of the method have otherwise; empty where there are none.
    """

    environment: str
    method: str
    max_episode_steps: int
    solved_at: float | None
    route: str
    runs: tuple[EvaluatedRun, ...]
    setting: str = ""

    @property
    def means(self) -> tuple[float, ...]:
        """The mean return of the tree of each run."""
        return tuple(run.row.mean for run in self.runs)

    @property
    def solved(self) -> int | None:
        """Runs whose tree solves the task; None where there is no threshold."""
        return None if self.solved_at is None else sum(bool(run.row.solved) for run in self.runs)

    @property
    def sizes(self) -> list[SizeRow]:
        """What the trees of each size do, from small to large."""
        return by_size(tree for run in self.runs for tree in run.by_size)

    def as_dict(self) -> Mapping[str, object]:
        """Return plain values for JSON."""
        return {
            **vars(self),
            "solved": self.solved,
            "worst_mean": min(self.means),
            "median_mean": float(np.median(self.means)),
            "runs": [run.as_dict() for run in self.runs],
            "sizes": [row.as_dict() for row in self.sizes],
        }

    def in_short(self) -> str:
        """Return one line over all runs."""
        means = f"worst seed mean {min(self.means):.2f}, median seed mean {np.median(self.means):.2f}"
        told = means if self.solved is None else f"solved {self.solved} of {len(self.runs)}, {means}"
        if (refiner := refiner_of(self.method)) and all(run.refined == 0 for run in self.runs):
            told += f"; {refiner} refined no tree"
        repeats = len({run.row.seed for run in self.runs}) < len(self.runs)
        return f"{told}; some seeds stand more than once" if repeats else told


@dataclass(frozen=True)
class SweepEvaluation:
    """The trees of many runs, all of an environment on the same test episodes.

    Attributes:
        episodes: Number of episodes.
        seed: Episode `i` began with `reset(seed=seed + i)`.
        methods: For each environment and method its runs.
        left_out: Lines that name the runs which are not among them, and say why.
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

    def as_text(self, form: Form = "plain") -> str:
        """Return tables in the form of where they are read."""
        title, line = ("**{}**", "* {}.") if form == "markdown" else ("{}", "{}")
        last = self.seed + self.episodes - 1
        parts = []
        for method in self.methods:
            threshold = "" if method.solved_at is None else f", solved from {method.solved_at:g}"
            episodes = f"{self.episodes:,} episodes, seeds {self.seed} to {last}"
            setting = f", {method.setting}" if method.setting else ""
            name = f"{method.environment} {method.method}{setting}"
            name = title.format(in_markdown(name) if form == "markdown" else name)
            parts.append(f"{name} ({episodes}, {method.route} route{threshold})")
            parts += [runs_table([run.row for run in method.runs]).told(form), line.format(method.in_short())]
            if sizes := method.sizes:
                parts += [*([] if are_of_one_run(sizes) else [_BY_SIZE]), sizes_table(sizes).told(form)]
        return "\n\n".join(parts)
