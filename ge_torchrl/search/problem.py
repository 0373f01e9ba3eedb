"""What a search is given: the configuration, the compiled grammar, the environment, and who refines trees."""

from __future__ import annotations

from dataclasses import dataclass

from ge_torchrl.config import Config
from ge_torchrl.environments.backend import Backend
from ge_torchrl.ge.rule_tables import RuleTables
from ge_torchrl.refiners.protocol import Refiner


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything that stays the same from generation to generation.

    Attributes:
        config: The configuration, its budgets resolved.
        tables: The compiled grammar.
        backend: Runs trees, and counts their steps.
        refiner: Refines proposals on schedule; None where nothing does.
        polisher: The derivative-free search that goes on from what the refiner found; None where steps are dear.
    """

    config: Config
    tables: RuleTables
    backend: Backend
    refiner: Refiner | None
    polisher: Refiner | None

    @property
    def refines(self) -> bool:
        """Whether anything refines trees."""
        return self.refiner is not None or self.polisher is not None

    def refines_in(self, generation: int) -> bool:
        """Tell whether the refiner is due."""
        return self.refiner is not None and self.config.refiner.schedule.applies_to(generation)

    def polishes_in(self, generation: int) -> bool:
        """Tell whether the polish is due."""
        return self.polisher is not None and self.config.polish.applies_to(generation)
