"""Restarts: a search begins anew with another population, and at last the archives of all starts go on as one.

Runs from different populations end in different structures, and more generations do not lead from one to another. Of
several short searches the best of each size is a better start than one long search comes to. Source: restart
strategies in evolutionary computation; A. Auger and N. Hansen, "A restart CMA evolution strategy with increasing
population size", CEC 2005.
"""

from __future__ import annotations

from dataclasses import replace

from ge_torchrl.config import GEConfig
from ge_torchrl.search.archive import merged
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.state import SearchState


def begins_anew(ge: GEConfig, generation: int) -> bool:
    """Tell whether a generation is the first of a start other than the first one.

    With n restarts the generations have n + 2 equal parts: a part for each start, and one where all go on together.
    """
    part = _part(ge, generation)
    return 0 < part <= ge.restarts and part != _part(ge, generation - 1)


def goes_on_together(ge: GEConfig, generation: int) -> bool:
    """Tell whether a generation lies in the last part, where the archives of all starts are one."""
    return _part(ge, generation) == ge.restarts + 1


def together(problem: Problem, state: SearchState) -> SearchState:
    """Return the state with the archives of all starts as one."""
    if not state.set_aside:
        return state
    return replace(state, archive=merged(problem, [*state.set_aside, state.archive]), set_aside=())


def _part(ge: GEConfig, generation: int) -> int:
    return generation * (ge.restarts + 2) // ge.generations if ge.restarts > 0 else 0
