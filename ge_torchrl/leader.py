"""The fittest tree of each generation: how large it is, and whether it solves the task."""

from __future__ import annotations

import numpy as np

from ge_torchrl.config import Config
from ge_torchrl.search.champion import Contender
from ge_torchrl.search.evolution import Evolution, Generation
from ge_torchrl.search.fitness import measure
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.simplify import simplify_exact


def validation_seeds(config: Config) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Return the episodes that choose and prune the champion."""
    rng = stream(config.seed, "validation episodes")
    return episode_seeds("validation", config.evaluation.validation_episodes, rng)


class LeaderObserver:
    """Looks at the fittest tree of each generation, and only when it is another one than before.

    Attributes:
        decision_nodes: Size of the fittest tree; None before there is one.
        solved: Whether a tree has solved the task on validation; asked only with `ge.stop_when_solved`.
        env_steps: Environment steps of asking.
    """

    def __init__(self, config: Config, evolution: Evolution) -> None:
        self.decision_nodes: int | None = None
        self.solved = False
        self.env_steps = 0
        self._evolution = evolution
        self._spec = evolution.route.spec
        self._codons: np.ndarray[tuple[int], np.dtype[np.int32]] | None = None
        self._n_refined = 0
        self._validation_seeds = validation_seeds(config) if config.ge.stop_when_solved else None

    def observe(self, generation: Generation, refined: tuple[Contender, ...]) -> None:
        """Note the size of the fittest tree, and whether it, or a refined one, solves the task on validation."""
        for contender in refined[self._n_refined :]:
            self._ask_validation(contender.tree, contender.fitness)
        self._n_refined = len(refined)
        codons = generation.codons[generation.best]
        if self._codons is not None and np.array_equal(codons, self._codons):
            return
        self._codons = codons
        mapping = self._evolution.map(codons[np.newaxis])
        if mapping.valid[0]:
            tree = simplify_exact(mapping.forest.tree(0), self._spec.low, self._spec.high)
            self.decision_nodes = tree.n_decision_nodes
            self._ask_validation(tree, float(generation.fitness[generation.best]))

    def _ask_validation(self, tree: DecisionTree, fitness: float) -> None:
        # Few training episodes say "solved" too easily: the validation episodes have to agree.
        if self._validation_seeds is not None and self._spec.is_solved(fitness):
            validated = measure(self._evolution.route, Forest.stack([tree]), self._validation_seeds)
            self.env_steps += validated.env_steps
            self.solved = self.solved or self._spec.is_solved(float(validated.fitness[0]))
