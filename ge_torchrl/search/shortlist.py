"""The short list: many new structures get a short polish, and only the best of them a whole one.

How fit a new structure is before its numbers fit it tells little about how fit it can become. A short polish tells
more, at a fraction of the cost. Source: successive halving, K. Jamieson and A. Talwalkar, "Non-stochastic best arm
identification and hyperparameter optimization" (2016).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from ge_torchrl.refiners.protocol import Effort
from ge_torchrl.search.archive import Archive
from ge_torchrl.search.fitness import measure
from ge_torchrl.search.problem import Problem
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

SHORT_LIST: Final = "short list"
"""The purpose that steps of comparing short-listed trees are counted under."""
# A quarter of the episodes and a seventh of the steps of a whole polish; tried on Acrobot.
_SHORT: Final = Effort(factor=0.25, patience=0.6)


def best_after_a_short_polish(
    problem: Problem, archive: Archive, trees: Sequence[DecisionTree], n: int, generation: int
) -> list[tuple[DecisionTree, float]]:
    """Return the most promising trees as a short polish leaves them, each with its fitness, the best first.

    A tree promises the more, the less it is behind the best kept tree of its size; a size without one comes first.

    Args:
        problem: What is searched; it has a polisher.
        archive: The kept trees.
        trees: The short list.
        n: How many to return at most.
        generation: Number of the generation.
    """
    if problem.polisher is None:
        raise ValueError("a short list needs a polisher")
    if not trees:
        return []
    seed, config = problem.config.seed, problem.config
    name = f"short list, generation {generation}"
    rngs = [stream(seed, f"{name}, tree {i}") for i in range(len(trees))]
    polished = [one.tree for one in problem.polisher.refine(trees, rngs, _SHORT)]
    # New episodes: a polish overrates what it found on its own.
    seeds = episode_seeds("training", config.polish.episodes, stream(seed, name))
    fitness = measure(
        problem.backend, Forest.stack(polished), seeds, SHORT_LIST, config.evaluation.std_penalty
    )
    best = {
        size: archive.of_size(size)[0].archive_fitness
        for size in {member.tree.num_decision_nodes for member in archive.members}
    }
    behind = [
        best.get(tree.num_decision_nodes, -np.inf) - value
        for tree, value in zip(polished, fitness, strict=True)
    ]
    return [(polished[i], float(fitness[i])) for i in np.argsort(behind, kind="stable")[:n]]
