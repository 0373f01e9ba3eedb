"""How a run shares out the time and the steps that it may take, so that what follows the search has its part."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
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
# Episodes of validation and of the test that no run can do without: the test takes the champion as it is and pruned.
_VALIDATED, _TESTED = 1, 2
# What these take may exceed the allowance by so much.
_UTMOST = 1.1
# Where these take much, rounding and the last refinement have at most this part of what the search has with them.
_SMALL_SHARE = 0.125
# With all that, a run gets along in which the least takes this part of the allowance, where each tree that is born is
# one; every second one may be none.
_LEAST_SHARE = 0.6
# Importing and describing take their part of the seconds.
_FEWEST_SECONDS = 2.0
# Where an allowance proved too small, so many times as much is advised at least.
_TIMES_GIVEN = 1.5


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
        least_steps: Environment steps that a run makes at least, where episodes are as long as they can be.
        steps_per_second: How fast they are made.
    """

    started: float
    max_seconds: float | None
    max_env_steps: int | None
    ends: Mapping[Phase, float]
    least_steps: int
    steps_per_second: float

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

        n_least = evaluation.episodes + _VALIDATED + _TESTED

        def part(n_episodes: int) -> float:
            steps = n_episodes * max_episode_steps
            return max(
                steps / (max_env_steps or math.inf),
                _SECONDS_TO_SPARE * steps / speed / (ge.max_seconds or math.inf),
            )

        def share(n_trees: int, n_episodes: int, n_least_of_all: int) -> float:
            # In a small allowance the search, too, has the part that a first tree takes of the least.
            least = min(part(n_least_of_all), n_least_of_all / n_least)
            return max(least, min(_LARGEST_SHARE, part(n_trees * n_episodes)))

        # Kept trees of each number of decision nodes, the fittest individual and the best refined tree.
        n_sizes = archive.max_nodes + 1 if archive.enabled else 0
        test = share(n_sizes + 2, evaluation.test_episodes, _TESTED)
        validation = share(n_sizes * archive.keep + 2, evaluation.validation_episodes, _VALIDATED)
        most = 1 - test - validation
        rounding = min(_ROUNDING_SHARE, _SMALL_SHARE * most) if rounds else 0.0
        final = min(_LARGEST_SHARE, _SMALL_SHARE * most) if archive.final_keep > 0 or rounds else 0.0
        ends = {
            Phase.SEARCH: most - rounding - final,
            Phase.FINAL_REFINEMENT: most - rounding,
            Phase.ROUNDING: most,
            Phase.VALIDATION: 1 - test,
            Phase.TEST: 1 - min(part(_RECORDED + n_sizes), _RECORDED_SHARE * test),
            Phase.RECORD: 1.0,
        }
        least_steps = (n_least + evaluation.episodes) * max_episode_steps / _LEAST_SHARE
        return cls(started, ge.max_seconds, max_env_steps, ends, round_up(least_steps), speed)

    def until(self, phase: Phase) -> Limit | None:
        """Return the limit by which a phase has to end; None where there is none."""
        if self.max_seconds is None and self.max_env_steps is None:
            return None
        return replace(self._after(self.ends[phase]), utmost=self._after(_UTMOST))

    def _after(self, share: float) -> Limit:
        return Limit(
            deadline=math.inf if self.max_seconds is None else self.started + share * self.max_seconds,
            max_env_steps=None if self.max_env_steps is None else max(1, int(share * self.max_env_steps)),
        )

    def too_small(self, reason: str, looked: float) -> str:
        """Return what to say where a limit leaves no room for the least that a run does.

        Args:
            reason: The setting, without its section.
            looked: How long the environment was looked at before the search [s].
        """
        given, enough, unit = float(self.max_env_steps or 0), float(self.least_steps), "steps"
        if reason == "max_seconds":
            seconds = looked / _LEAST_SHARE + self.least_steps / self.steps_per_second
            given, enough, unit = self.max_seconds or 0.0, max(seconds, _FEWEST_SECONDS), "seconds"
        # What was not enough is not told as enough, although the machine was faster when its speed was measured.
        number = round_up(max(enough, _TIMES_GIVEN * given))
        return (
            f"ge.{reason}={given:.15g} must leave room for a first tree, its validation and its test, which may take "
            f"{number:,} {unit} here; type ge.{reason}={number}"
        )


def round_up(number: float) -> int:
    """Return the least integer of two figures that is not below a number above 0."""
    unit: int = 10 ** max(0, math.floor(math.log10(number)) - 1)
    return math.ceil(number / unit) * unit
