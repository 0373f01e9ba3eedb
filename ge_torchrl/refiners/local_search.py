"""Local search without gradients: the polish of what PPO found, and PPO's rival.

Actions of leaves first, one leaf at a time, since no parameter helps a leaf that errs; then parameters, one at a time
by moves of all lengths, and together by CMA-ES (Hansen, "The CMA evolution strategy: a tutorial", 2016), in units of
how far features spread. All trials of one tree are measured on the same episodes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.config import PolishConfig
from ge_torchrl.environments.backend import Backend
from ge_torchrl.refiners.one_thread import one_thread
from ge_torchrl.refiners.protocol import FIRST, Effort, Refined, TrainingRecord
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

# Steps that show how far features spread; enough for a few episodes, and a small part of any budget.
_PROBE_STEPS: Final = 500
# Length of the shortest move of a single parameter, in its unit; the longest is 1.
_SHORTEST_MOVE: Final = 0.01
# Moves are screened on one of so many episodes: that costs the trees little, and saves most of the steps.
_SCREENED_ON: Final = 4
# Moves that are measured on all episodes after screening.
_PROMISING: Final = 3
_LARGEST: Final = float(np.finfo(np.float32).max)


class LocalSearch:
    """Refines trees of one run; see `Refiner`.

    Args:
        backend: Measures trees, and counts its steps.
        config: The budget of one tree, in environment steps, and the episodes.
        purpose: What the backend counts the steps under.
    """

    def __init__(self, backend: Backend, config: PolishConfig, purpose: str) -> None:
        self._backend = backend
        self._config = config
        self._purpose = purpose

    def refine(
        self,
        trees: Sequence[DecisionTree],
        rngs: Sequence[np.random.Generator],
        effort: Effort = FIRST,
    ) -> list[Refined]:
        """Refine trees side by side, each on episodes that its own stream draws."""
        jobs = [partial(self._refine, tree, rng, effort) for tree, rng in zip(trees, rngs, strict=True)]
        with one_thread():
            # A lone tree has all threads of the backend to itself.
            return [jobs[0](self._backend)] if len(jobs) == 1 else self._backend.run_jobs(jobs)

    def _refine(
        self, tree: DecisionTree, rng: np.random.Generator, effort: Effort, backend: Backend
    ) -> Refined:
        return _Search(backend, tree, self._config, self._purpose, effort, rng).run()


class _Search:
    """The search of one tree: the best so far, and what is left of the budget."""

    def __init__(
        self,
        backend: Backend,
        tree: DecisionTree,
        config: PolishConfig,
        purpose: str,
        effort: Effort,
        rng: np.random.Generator,
    ) -> None:
        self._backend = backend
        self._purpose = purpose
        self._rng = rng
        self._first_step = effort.step * config.first_step
        self._moves = config.moves
        self._max_timesteps = effort.factor * effort.patience * config.max_timesteps
        self._seeds = episode_seeds("training", max(1, round(effort.factor * config.episodes)), rng)
        self._screening_seeds = self._seeds[: len(self._seeds) // _SCREENED_ON]
        self._timesteps = self._rounds = 0
        self._tree = tree
        self._fitness = self._returns(Forest.stack([tree]), self._seeds)[0]

    def run(self) -> Refined:
        """Search until the budget is spent or nothing gets better."""
        if self._tree.has_actions:
            self._choose_actions()
        if len(self._tree.parameters) > 0 and not self._is_over():
            units = self._units()
            self._move_single_parameters(units)
            self._move_all_parameters(units)
        return Refined(self._tree, TrainingRecord(timesteps=self._timesteps, updates=self._rounds))

    def _is_over(self) -> bool:
        return self._timesteps >= self._max_timesteps

    def _returns(self, forest: Forest, seeds: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the mean returns [P] of some trees."""
        outcomes = self._backend.evaluate(forest, seeds, self._purpose)
        self._timesteps += outcomes.env_steps
        self._rounds += 1
        returns: NDArray[np.float64] = outcomes.returns.mean(axis=1)
        return returns

    def _units(self) -> NDArray[np.float64]:
        """Return the unit [N] of each parameter, from what the tree sees."""
        (observations,) = self._backend.observe([self._tree], _PROBE_STEPS, [self._rng], self._purpose)
        self._timesteps += len(observations)
        names = self._backend.spec.names
        return self._tree.parameter_units(spread_of(observations), names.action_spread)

    def _choose_actions(self) -> None:
        """Give each leaf in turn its best action, the other leaves as they then are."""
        for leaf in range(self._tree.num_leaves):
            if self._is_over():
                return
            trials = _with_other_actions(self._tree, leaf, self._backend.spec.n_actions)
            if not trials:
                return
            returns = self._returns(Forest.stack(trials), self._seeds)
            winner = int(np.argmax(returns))
            if returns[winner] > self._fitness:
                self._tree, self._fitness = trials[winner], returns[winner]

    def _measure(self, parameters: NDArray[np.float32]) -> NDArray[np.float64]:
        """Measure the tree with other parameters [P, N], and keep the best of all; return the mean returns [P]."""
        returns = self._returns(Forest.of_parameters(self._tree, parameters), self._seeds)
        winner = int(np.argmax(returns))
        if returns[winner] > self._fitness:
            self._tree, self._fitness = self._tree.with_parameters(parameters[winner]), returns[winner]
        return returns

    def _move_single_parameters(self, units: NDArray[np.float64]) -> None:
        """Move one parameter after the other until no move makes the tree better or the budget is spent."""
        before = -math.inf
        while self._moves > 0 and self._fitness > before:
            before = self._fitness
            for parameter in self._rng.permutation(len(units)):
                if self._is_over():
                    return
                self._measure(self._promising_moves(int(parameter), units[parameter]))

    def _promising_moves(self, parameter: int, unit: float) -> NDArray[np.float32]:
        """Return the parameters of the best tree with one moved [P, N], in those ways that screening finds best."""
        lengths = _SHORTEST_MOVE ** self._rng.random(self._moves)
        signs = np.where(np.arange(self._moves) % 2 == 0, -1.0, 1.0)
        moved = np.tile(self._tree.parameters, (self._moves, 1))
        moved[:, parameter] = as_floats(float(self._tree.parameters[parameter]) + signs * lengths * unit)
        if len(self._screening_seeds) == 0 or self._moves <= _PROMISING:
            return moved
        returns = self._returns(Forest.of_parameters(self._tree, moved), self._screening_seeds)
        return moved[np.argsort(-returns, kind="stable")[:_PROMISING]]

    def _move_all_parameters(self, units: NDArray[np.float64]) -> None:
        """Move all parameters together by CMA-ES until the budget is spent or it has converged."""
        if self._is_over():
            return
        # It brings matplotlib along where that is installed: most of a second, which the first trees need not wait for.
        import cma

        center = self._tree.parameters.astype(np.float64)
        # pycma has no one-dimensional form: a lone parameter gets an idle companion.
        strategy = cma.CMAEvolutionStrategy(
            np.zeros(max(len(units), 2)),
            self._first_step,
            # Its numbers come from our stream, and NumPy's global one stays as it was.
            {
                "seed": np.nan,
                "randn": lambda *shape: self._rng.standard_normal(shape),
                "verbose": -9,
                "verb_log": 0,
            },
        )
        while not self._is_over() and not strategy.stop():
            points = strategy.ask()
            returns = self._measure(as_floats(center + units * np.array(points)[:, : len(units)]))
            strategy.tell(points, (-returns).tolist())


def spread_of(observations: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return [D], the standard deviation of each feature over observations [T, D]; 1 where it tells nothing."""
    with np.errstate(invalid="ignore"):
        spread = observations.astype(np.float64).std(axis=0)
    return np.where(np.isfinite(spread) & (spread > 0), spread, 1.0)


def as_floats(parameters: NDArray[np.float64]) -> NDArray[np.float32]:
    """Round to float32; what a wild step would overflow stays a number."""
    return np.clip(parameters, -_LARGEST, _LARGEST).astype(np.float32)


def _with_other_actions(tree: DecisionTree, leaf: int, n_actions: int) -> list[DecisionTree]:
    """Return the trees that differ in the action of one leaf."""
    trees = []
    for action in range(n_actions):
        if action != tree.action[leaf]:
            actions = tree.action.copy()
            actions[leaf] = action
            trees.append(tree.with_actions(actions))
    return trees
