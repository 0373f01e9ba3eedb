"""The loop over generations: step, tell, and stop when there is a reason to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ge_torchrl.environments.backend import LimitReachedError
from ge_torchrl.search.archive import digest
from ge_torchrl.search.fitness import measure, validation_seeds
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.state import Events, SearchState
from ge_torchrl.search.step import first_state, step
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

SOLVING = "asking validation"
"""The purpose that steps of `ge.stop_when_solved` are counted under."""

CALLBACK = "callback"
"""What stopped a search where whoever watches it asked for that."""

Watch = Callable[[SearchState, Events], bool]
"""Is shown a generation, and tells whether the search is to stop there."""


@dataclass(eq=False)
class Search:
    """A search as it goes on; whatever ends it, its last state is here.

    Attributes:
        problem: What is searched.
        watch: Is shown every state with what happened in its generation, and may stop the search.
        state: The last state; None before the first generation.
        asked: Digests of trees that validation was asked of, whether they solve the task: each is asked once.
    """

    problem: Problem
    watch: Watch
    state: SearchState | None = None
    asked: frozenset[bytes] = frozenset()
    _is_called_off: bool = False

    def run(self) -> str:
        """Go from generation to generation until something stops it; return what did.

        Raises:
            KeyboardInterrupt: It came before the first generation was there.
            LimitReachedError: The limit was reached before it was.
        """
        try:
            state = self._shown(first_state(self.problem)) if self.state is None else self.state
            while (reason := self._reason_to_stop(state)) is None:
                state = self._shown(step(self.problem, state))
        except KeyboardInterrupt:
            if self.state is None:
                raise
            return "interrupt"
        except LimitReachedError as limit:
            if self.state is None:
                raise
            return limit.reason
        return reason

    def _shown(self, came: tuple[SearchState, Events]) -> SearchState:
        self.state, events = came
        self._is_called_off = self.watch(self.state, events)
        return self.state

    def _reason_to_stop(self, state: SearchState) -> str | None:
        ge = self.problem.config.ge
        if self._is_called_off:
            return CALLBACK
        if state.generation + 1 >= ge.generations:
            return "generations"
        return "solved" if ge.stop_when_solved and self._is_solved(state) else None

    def _is_solved(self, state: SearchState) -> bool:
        """Tell whether a tree that solves the task on training episodes does so on validation's."""
        problem, spec = self.problem, self.problem.backend.spec
        leading: list[DecisionTree] = []
        if spec.is_solved(float(state.population.fitness.max())):
            leading.append(state.population.forest.tree(state.population.best))
        if state.best_refined is not None and spec.is_solved(state.best_refined.fitness):
            leading.append(state.best_refined.tree)
        new = [tree for tree in leading if digest(tree) not in self.asked]
        self.asked |= {digest(tree) for tree in new}
        if not new:
            return False
        fitness = measure(problem.backend, Forest.stack(new), validation_seeds(problem.config), SOLVING)
        return any(spec.is_solved(float(value)) for value in fitness)
