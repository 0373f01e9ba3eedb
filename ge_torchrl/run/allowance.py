"""How a run shares out the time and the steps that it may take, so that what follows the search has its part."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from ge_torchrl.config import Config
from ge_torchrl.environments.backend import Limit

# A phase after the search may take this part of the allowance at most.
_LARGEST_SHARE = 0.1
# Rounding asks of each term and each digit whether it is needed; the last refinement leaves it so much.
_ROUNDING_SHARE = 0.1
# Episodes that are played once more for the run's page, beside one of each size; and what of the test's part they take
# at most.
_RECORDED, _RECORDED_SHARE = 3, 0.1
# The speed was measured on other trees: a phase gets so many times the seconds that it seems to need.
_SECONDS_TO_SPARE = 3


class Phase(Enum):
    """A phase of a run, in the order of their ends."""

    SEARCH = "search"
    FINAL_REFINEMENT = "final refinement"
    ROUNDING = "rounding"
    VALIDATION = "validation"
    TEST = "test"
    RECORD = "record"


@dataclass(frozen=True)
class Allowance:
    """What a run may take.

    Attributes:
        started: When the run began, by `time.perf_counter` [s].
        max_seconds: Clock time of the whole run [s]; None for any.
        max_env_steps: Environment steps of the whole run; None for any.
        ends: The share of the allowance at which each phase has to end.
    """

    started: float
    max_seconds: float | None
    max_env_steps: int | None
    ends: Mapping[Phase, float]

    @classmethod
    def of(cls, config: Config, started: float, max_episode_steps: int, *, rounds: bool = False) -> Allowance:
        """Return the allowance of a run: each phase after the search gets what it needs, and the search the rest.

        Args:
            config: The configuration, its budgets resolved.
            started: When the run began.
            max_episode_steps: The longest episode.
            rounds: Whether trees are rounded after the search.
        """
        ge, evaluation, archive = config.ge, config.evaluation, config.archive
        max_env_steps, speed = ge.max_env_steps or None, evaluation.steps_per_second or math.inf

        def share(n_trees: int, n_episodes: int) -> float:
            steps = n_trees * n_episodes * max_episode_steps
            needed = max(
                steps / (max_env_steps or math.inf),
                _SECONDS_TO_SPARE * steps / speed / (ge.max_seconds or math.inf),
            )
            return min(_LARGEST_SHARE, needed)

        # Kept trees of each number of decision nodes, the fittest individual and the best refined tree.
        n_sizes = archive.max_nodes + 1 if archive.enabled else 0
        test = share(n_sizes + 2, evaluation.test_episodes)
        validation = share(n_sizes * archive.keep + 2, evaluation.validation_episodes)
        rounding = _ROUNDING_SHARE if rounds else 0.0
        final = _LARGEST_SHARE if archive.final_keep > 0 or rounds else 0.0
        ends = {
            Phase.SEARCH: 1 - test - validation - rounding - final,
            Phase.FINAL_REFINEMENT: 1 - test - validation - rounding,
            Phase.ROUNDING: 1 - test - validation,
            Phase.VALIDATION: 1 - test,
            Phase.TEST: 1 - min(share(1, _RECORDED + n_sizes), _RECORDED_SHARE * test),
            Phase.RECORD: 1.0,
        }
        return cls(started, ge.max_seconds, max_env_steps, ends)

    def until(self, phase: Phase) -> Limit | None:
        """Return the limit by which a phase has to end; None where there is none."""
        if self.max_seconds is None and self.max_env_steps is None:
            return None
        share = self.ends[phase]
        return Limit(
            deadline=math.inf if self.max_seconds is None else self.started + share * self.max_seconds,
            max_env_steps=None if self.max_env_steps is None else max(1, int(share * self.max_env_steps)),
        )
