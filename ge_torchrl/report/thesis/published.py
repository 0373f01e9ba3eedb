"""The numbers that the thesis prints, to stand beside ours.

Source: "Backpropagation-based reinforcement learning for decision trees", chapter 4. Its runs are of
Grammatical Evolution with PPO; each best tree was tested on 100 unseen episodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class PublishedRun:
    """One row of a table.

    Attributes:
        number: 1 for R1; its seed is one less.
        train_fitness: Training best fitness.
        test_mean: Testing best fitness.
        complexity_M: The metric M.
    """

    number: int
    train_fitness: float
    test_mean: float
    complexity_M: float  # noqa: N815 (the paper's symbol)

    @property
    def seed(self) -> int:
        """Seed of the run."""
        return self.number - 1


@dataclass(frozen=True)
class PublishedSweep:
    """The ten runs in one environment.

    Attributes:
        environment: Gymnasium id.
        table: Number of the table, such as "4.3".
        solved_at: Mean return from which a run counts as solved.
        runs: The rows.
        solved: Runs that solved the task, as the text says.
        refinements: Applications of PPO to a tree.
        refinements_improved: Those that improved the tree; None where the text gives no number.
        refinements_in_words: What the text says about them.
    """

    environment: str
    table: str
    solved_at: float
    runs: tuple[PublishedRun, ...]
    solved: int
    refinements: int
    refinements_improved: int | None
    refinements_in_words: str

    def run_of_seed(self, seed: int) -> PublishedRun | None:
        """Return the run of a seed, or None where there is none."""
        return next((run for run in self.runs if run.seed == seed), None)

    def is_solved(self, run: PublishedRun) -> bool:
        """Return whether a run's test mean reaches the threshold."""
        return run.test_mean >= self.solved_at


def _rows(*rows: tuple[float, float, float]) -> tuple[PublishedRun, ...]:
    return tuple(PublishedRun(number, *row) for number, row in enumerate(rows, 1))


_CARTPOLE = PublishedSweep(
    environment="CartPole-v1",
    table="4.3",
    solved_at=475.0,
    runs=_rows(
        (500.00, 500.00, 53.4),
        (234.8, 199.71, 35.6),
        (500.00, 487.40, 53.4),
        (500.00, 499.28, 53.4),
        (500.00, 488.20, 35.6),
        (500.00, 498.05, 53.4),
        (500.00, 486.26, 53.4),
        (500.00, 500.00, 35.6),
        (500.00, 493.96, 53.4),
        (500.00, 498.8, 53.4),
    ),
    solved=9,
    refinements=40,
    refinements_improved=29,
    refinements_in_words="29 of 40 improved the tree, 4 of them to the highest possible return",
)

_ACROBOT = PublishedSweep(
    environment="Acrobot-v1",
    table="4.6",
    solved_at=-100.0,
    runs=_rows(
        (-81.0, -83.43, 35.6),
        (-80.0, -88.71, 35.6),
        (-81.2, -88.07, 35.6),
        (-75.4, -84.85, 71.2),
        (-76.4, -82.32, 35.6),
        (-83.6, -84.23, 17.8),
        (-74.2, -83.94, 35.6),
        (-70.4, -87.91, 35.6),
        (-83.0, -83.87, 35.6),
        (-87.6, -85.03, 53.4),
    ),
    solved=10,
    refinements=30,
    refinements_improved=None,
    refinements_in_words="almost none of 30 improved the tree, and none was the best of its generation",
)

_MOUNTAINCAR = PublishedSweep(
    environment="MountainCar-v0",
    table="4.9",
    solved_at=-110.0,
    runs=_rows(
        (-108.1, -108.27, 71.2),
        (-100.0, -100.69, 71.2),
        (-107.89, -107.89, 71.2),
        (-115.5, -115.58, 53.4),
        (-108.0, -108.06, 106.8),
        (-115.5, -115.58, 35.6),
        (-115.5, -115.58, 35.6),
        (-99.6, -115.34, 89.0),
        (-104.1, -103.14, 89.0),
        (-104.3, -111.75, 106.8),
    ),
    solved=5,
    refinements=39,
    refinements_improved=12,
    refinements_in_words="12 of 39 improved the tree, once to the best of the whole run",
)

PUBLISHED: Mapping[str, PublishedSweep] = MappingProxyType(
    {sweep.environment: sweep for sweep in (_CARTPOLE, _ACROBOT, _MOUNTAINCAR)}
)
