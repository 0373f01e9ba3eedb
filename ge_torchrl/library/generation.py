"""What a callback is told: a generation, and what the search has found by then."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from functools import cached_property

import numpy as np

from ge_torchrl.artefacts.records import GenerationRecord
from ge_torchrl.errors import UserError
from ge_torchrl.library.controller import Controller
from ge_torchrl.library.controllers import Controllers
from ge_torchrl.search.state import SearchState
from ge_torchrl.trees.controller import Names


@dataclass(frozen=True)
class Generation(GenerationRecord):
    """A generation that has just ended: its line of the history, and the controllers so far.

    Attributes:
        names: The environment and the names of its features and actions.
        state: The state of the search.
    """

    names: Names = field(kw_only=True, repr=False)
    state: SearchState = field(kw_only=True, repr=False, compare=False)

    @classmethod
    def of(cls, record: GenerationRecord, names: Names, state: SearchState) -> Generation:
        """Return a record with what was found by then."""
        told = {entry.name: getattr(record, entry.name) for entry in fields(record)}
        return cls(**told, names=names, state=state)

    @cached_property
    def controllers(self) -> Controllers:
        """The best controller of each number of decision nodes that is kept; validation has not chosen yet."""
        best: dict[int, Controller] = {}
        for member in self.state.archive.members:
            told = {"archive_mean": member.archive_fitness}
            best.setdefault(member.tree.num_decision_nodes, Controller(member.tree, self.names, told))
        return Controllers(best)

    @property
    def champion(self) -> Controller | None:
        """The fittest tree so far, by its training episodes; None where there is no tree."""
        population, refined = self.state.population, self.state.best_refined
        if refined is not None and refined.fitness >= population.fitness.max():
            return Controller(refined.tree, self.names)
        if not np.isfinite(population.fitness.max()):
            return None
        return Controller(population.forest.tree(population.best), self.names)


Callback = Callable[[Generation], bool | None]
"""Is told of each generation; True stops the search there, and the run goes on to its end: refinement and test."""


def stops(answer: object) -> bool:
    """Tell whether the answer of a callback stops the search.

    Raises:
        UserError: It is neither true nor false nor None.
    """
    if answer is None or isinstance(answer, bool | np.bool_):
        return bool(answer)
    raise UserError(f"callback must return True to stop, or False or None to go on; got {answer!r}")
