"""The archive: the best trees found for each number of decision nodes.

A run passes good small trees on its way and loses them to larger ones that are fitter on the training episodes. The
archive is one niche a size (Mouret and Clune, "Illuminating search spaces by mapping elites", 2015). What is offered
is measured on episodes that evolution never selects on; what these episodes do not visit is pruned before the size is
counted.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.config import ArchiveConfig
from ge_torchrl.refiners.folding import half_of, tied_leaves
from ge_torchrl.refiners.mirror import Mirror
from ge_torchrl.search.fitness import archive_seeds, fitness_of
from ge_torchrl.search.population import Population
from ge_torchrl.search.problem import Problem
from ge_torchrl.seeding import stream
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.simplify import prune, simplify
from ge_torchrl.trees.tree import DecisionTree, FloatArray

ARCHIVE = "archive"
"""The purpose that steps of measuring and observing for the archive are counted under."""
POPULATION, REFINEMENT, POLISH, START, RACE = "population", "refinement", "polish", "start", "race"
"""Where a tree comes from."""

# A tree so many times larger than the largest kept one may still be pruned to a kept size.
_LARGEST_OFFERED = 2
# States of each kept tree, from which thresholds of its neighbours are drawn: where steps are nearly free, and where
# they are dear.
_OBSERVED, _OBSERVED_WHERE_DEAR = 500, 100


@dataclass(frozen=True, eq=False)
class Contender:
    """A tree that might be kept, or be the champion.

    Attributes:
        tree: The tree.
        fitness: Its fitness on training episodes.
        origin: POPULATION, REFINEMENT for what the refiner made, POLISH for what only the polish changed, START for a
            dense start, or RACE for who won a race.
    """

    tree: DecisionTree
    fitness: float
    origin: str


@dataclass(frozen=True, eq=False)
class Member:
    """A kept tree.

    Attributes:
        tree: The tree, pruned.
        archive_fitness: Its fitness on the archive's episodes, and on others that confirmed it; by which it is kept.
        train_fitness: Its fitness on training episodes when it was offered.
        origin: As of a contender.
        observed: [T, D] float32, observations that it acted on.
        confirmed_on: How many episodes confirmed it beside the archive's own.
    """

    tree: DecisionTree
    archive_fitness: float
    train_fitness: float
    origin: str
    observed: FloatArray
    confirmed_on: int = 0


@dataclass(frozen=True, eq=False)
class Archive:
    """The kept trees.

    Attributes:
        members: From small to large, of each size the best first; of each size every one has another structure.
        offered: Digests of all trees that were ever offered: each is measured once.
    """

    members: tuple[Member, ...] = ()
    offered: frozenset[bytes] = frozenset()

    def of_size(self, num_decision_nodes: int) -> list[Member]:
        """Return the kept trees of one size, the best first."""
        return [member for member in self.members if member.tree.num_decision_nodes == num_decision_nodes]


def digest(tree: DecisionTree) -> bytes:
    """Return what tells a tree from others, in 16 bytes that are the same on every machine."""
    return hashlib.blake2b(tree.structure + tree.parameters.tobytes(), digest_size=16).digest()


def offer(problem: Problem, archive: Archive, contenders: Iterable[Contender]) -> Archive:
    """Return the archive after an offer: new trees are measured in one batch, the best of each size stay.

    Trees that are equal once simplified are one tree. Of equally good ones the first that was offered stays.

    Args:
        problem: What is searched.
        archive: The archive before.
        contenders: What is offered, in an order that does not depend on clocks.
    """
    settings = problem.config.archive
    if settings.keep == 0:
        return archive
    new = _new(problem, archive, list(contenders))
    if not new:
        return archive
    trees = [contender.tree for contender in new]
    outcomes = problem.backend.evaluate(
        Forest.stack(trees), archive_seeds(problem.config), ARCHIVE, visits=True
    )
    fitness = fitness_of(outcomes.returns, problem.config.evaluation.std_penalty)
    pruned = prune_all(trees, outcomes.leaf_visits, problem.mirror)
    kept = _Kept(settings, archive)
    for tree, contender, value in zip(pruned, new, map(float, fitness), strict=True):
        kept.add(_Candidate(tree, value, contender))
    return Archive(kept.members(problem), archive.offered | {digest(tree) for tree in (*trees, *pruned)})


def merged(problem: Problem, archives: Sequence[Archive]) -> Archive:
    """Return one archive of several: the best of each size, of equally good ones those of the earlier archive."""
    first, *others = archives
    kept = _Kept(problem.config.archive, first)
    for member in (member for archive in others for member in archive.members):
        kept.add(member)
    return Archive(kept.members(problem), frozenset().union(*(archive.offered for archive in archives)))


def confirmed(
    problem: Problem, archive: Archive, tree: DecisionTree, returns: NDArray[np.float64]
) -> Archive:
    """Return the archive with a kept tree measured on more episodes: what luck has chosen goes when others pass it.

    Args:
        problem: What is searched.
        archive: The archive before.
        tree: A kept tree; any other changes nothing.
        returns: [E] of it, in episodes on which nothing was chosen.
    """
    found = [member for member in archive.members if member.tree == tree]
    if not found or len(returns) == 0:
        return archive
    (member,) = found
    before = problem.config.archive.episodes + member.confirmed_on
    fitness = float(fitness_of(returns[np.newaxis], problem.config.evaluation.std_penalty)[0])
    share = len(returns) / (before + len(returns))
    more = replace(
        member,
        archive_fitness=(1 - share) * member.archive_fitness + share * fitness,
        confirmed_on=member.confirmed_on + len(returns),
    )
    members = [more if other is member else other for other in archive.members]
    members.sort(key=lambda one: (one.tree.num_decision_nodes, -one.archive_fitness))
    return replace(archive, members=tuple(members))


def prune_all(
    trees: Sequence[DecisionTree], leaf_visits: NDArray[np.int64] | None, mirror: Mirror | None = None
) -> list[DecisionTree]:
    """Return trees without what some episodes did not visit.

    Args:
        trees: The trees, in the order in which they were measured.
        leaf_visits: Visits of all their leaves, tree after tree.
        mirror: Of the environment, where it has one: a tree that is its own image stays so.
    """
    if leaf_visits is None:
        raise ValueError("pruning needs visits: evaluate(..., visits=True)")
    ends = np.cumsum([tree.num_leaves for tree in trees])
    return [
        prune(tree, visits if mirror is None else _with_images(tree, visits, mirror))
        for tree, visits in zip(trees, np.split(leaf_visits, ends[:-1]), strict=True)
    ]


def _with_images(tree: DecisionTree, visits: NDArray[np.int64], mirror: Mirror) -> NDArray[np.int64]:
    """Return visits in which a leaf of a tree that is its own image counts those of its image too."""
    half = half_of(tree, mirror)
    if half is None:
        return visits
    tied = tied_leaves(half, mirror)
    return np.bincount(tied, weights=visits)[tied].astype(np.int64)


def leaders(population: Population, max_nodes: int) -> list[Contender]:
    """Return the fittest individual of each size, from small to large; of equally fit ones the first.

    Args:
        population: The population.
        max_nodes: Decision nodes of the largest leader.
    """
    fitness, sizes = population.fitness, population.sizes
    candidates = np.flatnonzero(np.isfinite(fitness) & (sizes <= max_nodes))
    ordered = candidates[np.lexsort((-fitness[candidates], sizes[candidates]))]
    _, first = np.unique(sizes[ordered], return_index=True)
    return [Contender(population.forest.tree(int(i)), float(fitness[i]), POPULATION) for i in ordered[first]]


def _new(problem: Problem, archive: Archive, contenders: list[Contender]) -> list[Contender]:
    """Return those contenders that are small enough and were not offered before, simplified, each once."""
    if not contenders:
        return []
    simple = simplify(Forest.stack([contender.tree for contender in contenders]), *problem.backend.bounds)
    largest = _LARGEST_OFFERED * problem.config.archive.max_nodes
    new: dict[bytes, Contender] = {}
    for tree, contender in zip(simple.trees(), contenders, strict=True):
        key = digest(tree)
        if tree.num_decision_nodes <= largest and key not in archive.offered:
            new.setdefault(key, Contender(tree, contender.fitness, contender.origin))
    return list(new.values())


@dataclass(frozen=True, eq=False)
class _Candidate:
    tree: DecisionTree
    fitness: float
    contender: Contender


class _Kept:
    """The trees of each size while an offer is sorted in."""

    def __init__(self, settings: ArchiveConfig, archive: Archive) -> None:
        self._settings = settings
        self._by_size: dict[int, list[Member | _Candidate]] = {}
        for member in archive.members:
            self._by_size.setdefault(member.tree.num_decision_nodes, []).append(member)

    def add(self, entry: Member | _Candidate) -> None:
        """Sort in a tree, if it is among the best of its size and better than the kept one of its structure."""
        size = entry.tree.num_decision_nodes
        if size > self._settings.max_nodes:
            return
        rivals = self._by_size.get(size, [])
        alike = [rival for rival in rivals if rival.tree.structure == entry.tree.structure]
        if any(_fitness(rival) >= _fitness(entry) for rival in alike):
            return
        rivals = [rival for rival in rivals if rival not in alike]
        rivals.append(entry)
        rivals.sort(key=lambda rival: -_fitness(rival))
        self._by_size[size] = rivals[: self._settings.keep]

    def members(self, problem: Problem) -> tuple[Member, ...]:
        """Return the kept trees; those that are new are observed now."""
        entries = [rival for size in sorted(self._by_size) for rival in self._by_size[size]]
        new = [entry for entry in entries if isinstance(entry, _Candidate)]
        observed = _observe(problem, [entry.tree for entry in new])
        seen = {id(entry): observations for entry, observations in zip(new, observed, strict=True)}
        return tuple(
            entry
            if isinstance(entry, Member)
            else Member(
                entry.tree,
                entry.fitness,
                entry.contender.fitness,
                entry.contender.origin,
                seen[id(entry)],
            )
            for entry in entries
        )


def _fitness(entry: Member | _Candidate) -> float:
    return entry.archive_fitness if isinstance(entry, Member) else entry.fitness


def _observe(problem: Problem, trees: Sequence[DecisionTree]) -> Sequence[FloatArray]:
    """Return what trees see; it depends on each tree alone, not on when it entered. Neighbours alone need it."""
    if not trees or problem.config.archive.neighbours == 0:
        return [np.zeros((0, problem.backend.spec.n_features), np.float32)] * len(trees)
    rngs = [stream(problem.config.seed, f"observations of {digest(tree).hex()}") for tree in trees]
    n_steps = _OBSERVED if problem.polisher is not None else _OBSERVED_WHERE_DEAR
    return list(problem.backend.observe(trees, n_steps, rngs, ARCHIVE))
