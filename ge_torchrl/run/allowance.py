"""How a run shares out the time and the steps that it may take, so that what follows the search has its part."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from ge_torchrl.config import Config
from ge_torchrl.environments.backend import Limit


class Phase(Enum):
    """A phase of a run; its value is the share of the allowance at which it has to end."""

    SEARCH = 0.7
    FINAL_REFINEMENT = 0.8
    VALIDATION = 0.9
    TEST = 1.0


@dataclass(frozen=True)
class Allowance:
    """What a run may take.

    Attributes:
        started: When the run began, by `time.perf_counter` [s].
        max_seconds: Clock time of the whole run [s]; None for any.
        max_env_steps: Environment steps of the whole run; None for any.
    """

    started: float
    max_seconds: float | None
    max_env_steps: int | None

    @classmethod
    def of(cls, config: Config, started: float) -> Allowance:
        """Return the allowance of a configuration for a run that began at `started`."""
        return cls(started, config.ge.max_seconds, config.ge.max_env_steps or None)

    def until(self, phase: Phase) -> Limit | None:
        """Return the limit by which a phase has to end; None where there is none."""
        if self.max_seconds is None and self.max_env_steps is None:
            return None
        share = phase.value
        return Limit(
            deadline=math.inf if self.max_seconds is None else self.started + share * self.max_seconds,
            max_env_steps=None if self.max_env_steps is None else max(1, int(share * self.max_env_steps)),
        )
