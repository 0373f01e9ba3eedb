"""An evolution strategy for episodes that are dear and returns that have heavy tails.

CMA-ES (Hansen, "The CMA evolution strategy: a tutorial", 2016) moves all numbers of a tree together. All points of a
round run on the same few episodes, new ones in each round, so that no tree is fitted to its episodes. Rounds begin with
few episodes and take twice as many as soon as the returns of the points can no longer be told apart: where
`F = E var(means) / var(rest)`, over `E` episodes, stays low. What the strategy stands for is its mean, which no luck
has chosen, and not the best point it saw.
"""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import Backend
from ge_torchrl.refiners.one_thread import one_thread
from ge_torchrl.refiners.ties import Ties
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

# Points of a round, and its first episodes.
_POINTS: Final = 12
FEWEST_EPISODES: Final = 3
# Points are told apart where the median F of so many rounds is as large as this.
_ROUNDS: Final = 4
_TOLD_APART: Final = 2.0
# Of more numbers than these each has a step of its own, and no two are moved together: a covariance of thousands would
# take longer than the episodes.
_MOST_TOGETHER: Final = 200
_LARGEST: Final = float(np.finfo(np.float32).max)


class Strategy:
    """The search for the numbers of one tree; it goes on for as long as it is told to.

    Args:
        backend: Measures trees, and counts its steps.
        tree: Whose structure it is, and whose numbers where the search starts from them.
        ties: Which of its numbers are one.
        units: [N] a natural step of each parameter.
        first_step: Standard deviation of the first moves, in these units.
        purpose: What the backend counts the steps under.
        rng: Of all its randomness.
        from_zero: Whether the search starts with all numbers at 0: there no direction is favoured.
        episodes: Of the first round.
        most_episodes: Of any round.

    Attributes:
        timesteps: Environment steps so far.
        rounds: Rounds so far.
        episodes: Of the next round.
        has_ended: Whether the strategy has converged, or has nothing to move.
    """

    def __init__(
        self,
        backend: Backend,
        tree: DecisionTree,
        ties: Ties,
        units: NDArray[np.float64],
        first_step: float,
        purpose: str,
        rng: np.random.Generator,
        *,
        from_zero: bool = False,
        episodes: int = FEWEST_EPISODES,
        most_episodes: int = 96,
    ) -> None:
        # It brings matplotlib along where that is installed: most of a second, which the first trees need not wait for.
        import cma

        self._backend, self._tree, self._ties = backend, tree, ties
        self._purpose, self._rng = purpose, rng
        self._most_episodes = most_episodes
        self._units = units[ties.leading]
        numbers = tree.parameters.astype(np.float64)[ties.leading]
        self._center = np.zeros_like(numbers) if from_zero else numbers
        self._told_apart: deque[float] = deque(maxlen=_ROUNDS)
        self.timesteps = self.rounds = 0
        self.episodes = min(episodes, most_episodes)
        # pycma has no one-dimensional form: a lone number gets an idle companion.
        self._cma = cma.CMAEvolutionStrategy(
            np.zeros(max(len(numbers), 2)),
            first_step,
            {
                "popsize": _POINTS,
                # Its numbers come from our stream, and NumPy's global one stays as it was.
                "seed": np.nan,
                "CMA_diagonal": len(numbers) > _MOST_TOGETHER,
                "randn": lambda *shape: rng.standard_normal(shape),
                "verbose": -9,
                "verb_log": 0,
            },
        )

    @property
    def has_ended(self) -> bool:
        """Whether it has nothing to move, or has converged."""
        return len(self._center) == 0 or bool(self._cma.stop())

    @property
    def tree(self) -> DecisionTree:
        """The tree that the strategy stands for."""
        if self.rounds == 0:
            return self._tree
        return self._tree.with_parameters(self._parameters(np.asarray(self._cma.mean)))

    def advance(self, timesteps: int) -> None:
        """Go on for so many environment steps, to the end of a round.

        Raises:
            LimitReachedError: The backend's limit was reached first.
        """
        end = self.timesteps + timesteps
        with one_thread():
            while self.timesteps < end and not self.has_ended:
                self._round()

    def _round(self) -> None:
        points = self._cma.ask()
        forest = Forest.of_parameters(self._tree, self._parameters(np.array(points)))
        seeds = episode_seeds("training", self.episodes, self._rng)
        outcomes = self._backend.evaluate(forest, seeds, self._purpose)
        self._cma.tell(points, (-outcomes.returns.mean(axis=1)).tolist())
        self.timesteps += outcomes.env_steps
        self.rounds += 1
        self._told_apart.append(told_apart(outcomes.returns))
        if len(self._told_apart) == _ROUNDS and np.median(self._told_apart) < _TOLD_APART:
            self.episodes = min(2 * self.episodes, self._most_episodes)
            self._told_apart.clear()

    def _parameters(self, points: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return the parameters [..., N] of points [..., n]; what a wild step would overflow stays a number."""
        numbers = self._center + self._units * points[..., : len(self._center)]
        return np.clip(self._ties.parameters(numbers), -_LARGEST, _LARGEST).astype(np.float32)


def told_apart(returns: NDArray[np.float64]) -> float:
    """Return F, how far the mean returns of trees lie apart; about 1 where the trees are equal.

    Args:
        returns: [P, E] of P trees on the same E episodes, at least two of both. What an episode gives or costs all
            trees is left out.
    """
    n_trees, n_episodes = returns.shape
    means = returns.mean(axis=1, keepdims=True)
    rest = returns - means - returns.mean(axis=0) + returns.mean()
    noise = float(np.square(rest).sum()) / ((n_trees - 1) * (n_episodes - 1))
    between = n_episodes * float(means.var(ddof=1))
    return between / noise if noise > 0 else np.inf if between > 0 else 0.0
