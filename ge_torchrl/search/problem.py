"""What a search is given: the configuration, the compiled grammar, the environment, and who refines trees."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ge_torchrl.config import Config
from ge_torchrl.environments.backend import Backend
from ge_torchrl.ge.rule_tables import RuleTables
from ge_torchrl.refiners.mirror import Mirror
from ge_torchrl.refiners.protocol import Refiner
from ge_torchrl.search.fitness import Seeds, test_seeds


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything that stays the same from generation to generation.

    Attributes:
        config: The configuration, its budgets resolved.
        tables: The compiled grammar.
        backend: Runs trees, and counts their steps.
        refiner: Refines proposals on schedule; None where nothing does.
        polisher: The derivative-free search that goes on from what the refiner found; None where steps are dear.
        mirror: Of the environment; None where it is not known to have one.
        judging_seeds: Gives the episodes that judge what was found: those of the test, which a tuner must not see.
    """

    config: Config
    tables: RuleTables
    backend: Backend
    refiner: Refiner | None
    polisher: Refiner | None
    mirror: Mirror | None = None
    judging_seeds: Callable[[Config], Seeds] = test_seeds

    @property
    def has_sums(self) -> bool:
        """Whether the grammar weighs features, in splits or in leaves."""
        return self.is_oblique or self.has_linear_leaves

    @property
    def is_oblique(self) -> bool:
        """Whether splits weigh features."""
        return self.tables.grammar.splits == "oblique"

    @property
    def has_linear_leaves(self) -> bool:
        """Whether values of leaves may be linear in features."""
        return self.tables.grammar.leaves == "linear"

    @property
    def rounds(self) -> bool:
        """Whether kept trees are rounded at the end."""
        return self.has_sums and self.config.archive.enabled and self.config.starts.rounding_episodes > 0

    @property
    def imitates(self) -> bool:
        """Whether trees of a grammar without sums imitate a rule of sums that is found first: where steps are dear."""
        return not self.has_sums and not self.backend.spec.is_continuous and self.config.archive.races > 0

    def races_in(self, generation: int) -> bool:
        """Tell whether dense starts are raced."""
        races = self.config.starts.races if self.config.archive.enabled else 0
        return (self.has_sums or self.imitates) and 1 <= generation <= races

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
