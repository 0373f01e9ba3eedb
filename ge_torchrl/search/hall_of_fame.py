"""The hall of fame: the best tree found for each number of decision nodes.

A run passes good small trees on its way and loses them to larger ones that are fitter on the training episodes. Here
the leaders of every generation are measured again, each tree once, on episodes that evolution never selects on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.config import Config
from ge_torchrl.environments.route import Route
from ge_torchrl.ge.codons import Codons
from ge_torchrl.ge.mapping import Mapping
from ge_torchrl.search.champion import POPULATION, Champion, Contender
from ge_torchrl.search.evolution import Generation
from ge_torchrl.search.fitness import Fitness, measure
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.simplify import prune, simplify_exact

# A tree so many times larger than the largest kept one may still be pruned to a kept size.
_LARGEST_OFFERED = 2


@dataclass(frozen=True, eq=False)
class Winner:
    """The best tree of one size.

    Attributes:
        tree: The tree, pruned; its size is counted on this form.
        origin: As of a contender.
        archive_mean: Its mean return on the archive's episodes; None for a champion too large for the archive.
        validation_mean: Its mean return on the validation episodes that chose it.
    """

    tree: DecisionTree
    origin: str
    archive_mean: float | None
    validation_mean: float


@dataclass(frozen=True, eq=False)
class Winners:
    """The best tree of each size, and what choosing them took.

    Attributes:
        by_size: The winners, from small to large.
        env_steps: Environment steps of pruning and validation.
    """

    by_size: tuple[Winner, ...]
    env_steps: int


class HallOfFame:
    """Keeps a few trees of each size, each of another structure, the best on the archive's own episodes.

    Args:
        route: Runs the trees.
        seeds: [E] the archive's episodes, used for nothing else.
        keep: Trees of each size.
        max_nodes: Decision nodes of the largest trees.
    """

    def __init__(self, route: Route, seeds: NDArray[np.int64], keep: int, max_nodes: int) -> None:
        self._route = route
        self._seeds = seeds
        self._keep = keep
        self._max_nodes = max_nodes
        self._means: dict[DecisionTree, float] = {}
        self._kept: dict[int, list[Contender]] = {}
        self._last_leaders: frozenset[bytes] = frozenset()
        self._env_steps = 0

    @property
    def max_nodes(self) -> int:
        """Decision nodes of the largest trees."""
        return self._max_nodes

    @property
    def env_steps(self) -> int:
        """Environment steps of all measurements so far."""
        return self._env_steps

    @property
    def members(self) -> list[Contender]:
        """The trees that are kept, simplified, from small to large, of each size the best first."""
        return [contender for size in sorted(self._kept) for contender in self._kept[size]]

    def offer_leaders(self, generation: Generation, to_trees: Callable[[Codons], Mapping]) -> None:
        """Offer the fittest individual of each size.

        Args:
            generation: The generation.
            to_trees: Maps genotypes.
        """
        leaders = leaders_by_size(generation.fitness, generation.decision_nodes, self._max_nodes)
        # Most leaders lead for many generations: who led in the last one is known without mapping it again.
        genotypes = {generation.codons[leader].tobytes(): leader for leader in leaders}
        new = np.array(
            [leader for codons, leader in genotypes.items() if codons not in self._last_leaders], int
        )
        self._last_leaders = frozenset(genotypes)
        if len(new) == 0:
            return
        forest = to_trees(generation.codons[new]).forest
        self.offer(
            Contender(forest.tree(row), float(generation.fitness[leader]), POPULATION)
            for row, leader in enumerate(new)
        )

    def offer(self, contenders: Iterable[Contender]) -> None:
        """Measure those trees that are new and small enough, all in one batch, and keep the best of each size.

        Trees that are equal once simplified are one tree. What the archive's episodes do not visit is pruned before
        the size is counted. Of equally good ones the first that was
        offered stays.
        """
        new: dict[DecisionTree, Contender] = {}
        for contender in contenders:
            tree = simplify_exact(contender.tree, self._route.spec.low, self._route.spec.high)
            if tree.n_decision_nodes <= _LARGEST_OFFERED * self._max_nodes and tree not in self._means:
                new.setdefault(tree, Contender(tree, contender.fitness, contender.origin))
        if not new:
            return
        self._means.update(zip(new, self._measure(list(new)), strict=True))
        pruned: dict[DecisionTree, Contender] = {}
        for tree, contender in new.items():
            if not self._can_enter(tree):
                continue
            visits = self._route.count_visits(tree, self._seeds)
            self._env_steps += int(visits[0])
            smaller = prune(tree, visits)
            # Pruned on all of the archive's episodes, a tree does on them what it did.
            self._means.setdefault(smaller, self._means[tree])
            pruned.setdefault(smaller, Contender(smaller, contender.fitness, contender.origin))
        for tree, contender in pruned.items():
            if tree.n_decision_nodes <= self._max_nodes:
                self._keep_best(tree, contender)

    def _measure(self, trees: list[DecisionTree]) -> list[float]:
        measured = measure(self._route, Forest.stack(trees), self._seeds)
        self._env_steps += measured.env_steps
        return [float(fitness) for fitness in measured.fitness]

    def _can_enter(self, tree: DecisionTree) -> bool:
        """Tell whether a tree, pruned to some size or not at all, could be among the kept ones of its size."""
        sizes = range(min(tree.n_decision_nodes, self._max_nodes) + 1)
        full = [self._kept[size] for size in sizes if len(self._kept.get(size, ())) >= self._keep]
        return len(full) < len(sizes) or any(self._means[tree] > self._means[kept[-1].tree] for kept in full)

    def _keep_best(self, tree: DecisionTree, contender: Contender) -> None:
        kept = self._kept.setdefault(tree.n_decision_nodes, [])
        alike = [rival for rival in kept if rival.tree.structure == tree.structure]
        if alike and self._means[alike[0].tree] >= self._means[tree]:
            return
        rivals = [rival for rival in kept if rival not in alike]
        rivals.append(contender)
        rivals.sort(key=lambda rival: -self._means[rival.tree])
        self._kept[tree.n_decision_nodes] = rivals[: self._keep]

    def mean_of(self, member: Contender) -> float:
        """Return what the archive's episodes said of a member."""
        return self._means[member.tree]

    def archive_mean(self, tree: DecisionTree) -> float | None:
        """Return what the archive's episodes said of a tree; None where it was never measured."""
        return self._means.get(simplify_exact(tree, self._route.spec.low, self._route.spec.high))

    def choose_winners(self, champion: Champion, validation_seeds: NDArray[np.int64]) -> Winners:
        """Prune the kept trees, sort them anew by their size, and choose the best of each size by validation.

        Args:
            champion: The run's champion; of equally good trees of its size it wins.
            validation_seeds: [E] the episodes that chose it.
        """
        self.offer([Contender(champion.full, champion.train_fitness, champion.origin)])
        finalists = [
            (champion.pruned, champion.origin, self.archive_mean(champion.full)),
        ]
        env_steps = 0
        for member in self.members:
            visits = self._route.count_visits(member.tree, validation_seeds)
            env_steps += int(visits[0])
            finalists.append((prune(member.tree, visits), member.origin, self._means[member.tree]))
        validated = measure(self._route, Forest.stack([tree for tree, *_ in finalists]), validation_seeds)
        best: dict[int, Winner] = {}
        for finalist, mean in zip(finalists, map(float, validated.fitness), strict=True):
            size = finalist[0].n_decision_nodes
            if size not in best or mean > best[size].validation_mean:
                best[size] = Winner(*finalist, validation_mean=mean)
        return Winners(tuple(best[size] for size in sorted(best)), env_steps + validated.env_steps)


def open_hall_of_fame(config: Config, route: Route) -> HallOfFame | None:
    """Return an empty hall of fame with episodes of its own, or None where none is asked for."""
    settings = config.hall_of_fame
    if not settings.enabled:
        return None
    # Of the same purpose as validation, so that neither training nor the test shares an episode with them.
    seeds = episode_seeds("validation", settings.episodes, stream(config.seed, "archive episodes"))
    return HallOfFame(route, seeds, settings.keep, settings.max_nodes)


def leaders_by_size(fitness: Fitness, decision_nodes: NDArray[np.int64], max_nodes: int) -> NDArray[np.int64]:
    """Return the fittest individual of each size, from small to large; of equally fit ones the first.

    Args:
        fitness: [P] float64; individuals without a tree, at -inf, do not lead.
        decision_nodes: [P] int64.
        max_nodes: Decision nodes of the largest leader.

    Returns:
        [S] int64, indices of the leaders of the `S` sizes that there are.
    """
    candidates = np.flatnonzero(np.isfinite(fitness) & (decision_nodes <= max_nodes))
    ordered = candidates[np.lexsort((-fitness[candidates], decision_nodes[candidates]))]
    _, first = np.unique(decision_nodes[ordered], return_index=True)
    return ordered[first]
