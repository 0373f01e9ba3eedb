"""Search that goes on from the hall of fame: its trees' neighbours are refined, and its trees return to evolution.

Evolution keeps what is fit as it is; a new structure is mostly worse until its thresholds fit it, and dies before
that. So neighbours of good trees get their thresholds first and are judged then, which makes the hall of fame an
archive of elites, one niche a size (Mouret and Clune, "Illuminating search spaces by mapping elites", 2015), with
learning within a life.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.errors import UnencodableTreeError
from ge_torchrl.ge.encoding import can_derive, encode, snap
from ge_torchrl.search.candidate import fittest_of_each_structure, in_turns
from ge_torchrl.search.champion import NEIGHBOUR, Contender
from ge_torchrl.search.evolution import Evolution, Generation
from ge_torchrl.search.hall_of_fame import HallOfFame
from ge_torchrl.search.refinement import FIRST, Effort, RefinesTrees
from ge_torchrl.search.settling import settle
from ge_torchrl.sections import HallOfFameConfig
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.edits import EditedTree, stacked
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.simplify import simplify_forest

# States of each kept tree, from which the thresholds of its neighbours are drawn.
_OBSERVED = 500


@dataclass(frozen=True, eq=False)
class Explored:
    """What exploring brought.

    Attributes:
        generation: The generation, with migrants where there are any.
        refined: Trees refined: neighbours and kept ones.
        env_steps: Environment steps; those of the hall of fame's own measurements count there.
    """

    generation: Generation
    refined: int
    env_steps: int


class Explorer:
    """Explores from one run's hall of fame.

    Args:
        config: How much of what.
        evolution: Maps and measures.
        hall: The hall of fame.
        refiner: Refines trees.
        seed: The run's seed, from which all randomness follows.
        snaps: Whether refined trees are snapped to the grammar's constants before they are offered.
    """

    def __init__(
        self,
        config: HallOfFameConfig,
        evolution: Evolution,
        hall: HallOfFame,
        refiner: RefinesTrees,
        seed: int,
        *,
        snaps: bool,
    ) -> None:
        self._config = config
        self._evolution = evolution
        self._hall = hall
        self._refiner = refiner
        self._seed = seed
        self._snaps = snaps
        # One refinement a structure: another start mostly ends in the same tree, and new structures are many.
        self._tried: set[bytes] = set()
        self._edited: dict[DecisionTree, EditedTree] = {}
        self._features = np.flatnonzero([len(of) > 0 for of in evolution.tables.grammar.constants])

    def explore(self, generation: Generation) -> Explored:
        """Refine neighbours and some kept trees, offer them, and let kept trees migrate.

        Args:
            generation: Its training episodes judge neighbours; its least fit individuals give way to migrants.
        """
        rng = stream(self._seed, f"hall of fame in generation {generation.index}")
        if not self._hall.members:
            return Explored(generation, 0, 0)
        neighbours, env_steps = self._neighbours(generation.seeds, rng)
        refined, steps = self._refine(neighbours, FIRST, generation.seeds, rng)
        env_steps += steps
        revisited, steps = self._refine(
            self._some_members(rng), Effort(self._config.revisit_factor), generation.seeds, rng
        )
        env_steps += steps
        generation, steps = self._migrate(generation, rng)
        return Explored(generation, refined + revisited, env_steps + steps)

    def finish(self, seeds: NDArray[np.int64]) -> int:
        """Refine the best kept trees of each size once more, with the budget of the end.

        Args:
            seeds: [E] training episodes, which tell the fitness of what comes out.

        Returns:
            Environment steps; those of the hall of fame count there.
        """
        config, by_size = self._config, dict[int, list[DecisionTree]]()
        for member in self._hall.members:
            by_size.setdefault(member.tree.n_decision_nodes, []).append(member.tree)
        trees = [tree for size, kept in by_size.items() if size > 0 for tree in kept[: config.final_keep]]
        rng = stream(self._seed, "hall of fame at the end")
        effort = Effort(config.final_factor, config.final_patience, config.final_step)
        refined, env_steps = self._tuned(trees, effort, rng)
        if refined and self._snaps and config.final_settling_episodes > 0:
            settling_seeds = episode_seeds("training", config.final_settling_episodes, rng)
            refined, steps = self._settled(refined, settling_seeds)
            env_steps += steps
        return env_steps + self._offer(refined, seeds)

    def _neighbours(
        self, seeds: NDArray[np.int64], rng: np.random.Generator
    ) -> tuple[list[DecisionTree], int]:
        """Draw neighbours of kept trees and choose the fittest of each size, each of a structure not tried yet.

        Returns:
            The chosen trees, and environment steps.
        """
        if self._config.neighbours == 0:
            return [], 0
        drawn, env_steps = self._draw(rng)
        sizes = drawn.sizes // 2
        fitting = np.flatnonzero((sizes > 0) & (sizes <= self._hall.max_nodes))
        untried = [int(i) for i in fitting if drawn.structure(int(i)) not in self._tried]
        if not untried:
            return [], env_steps
        measured = self._evolution.measure(drawn, seeds)
        fitness = measured.fitness
        best = np.array(list(fittest_of_each_structure(drawn, fitness, untried).values()))
        trees: list[DecisionTree] = []
        for i in best[in_turns(fitness[best], sizes[best])]:
            tree = drawn.tree(int(i))
            # A grammar can say more than which features there are.
            if can_derive(tree, self._evolution.tables):
                trees.append(tree)
            if len(trees) == self._config.neighbours:
                break
        self._tried.update(tree.structure for tree in trees)
        return trees, env_steps + measured.env_steps

    def _draw(self, rng: np.random.Generator) -> tuple[Forest, int]:
        """Draw neighbours of kept trees that small tournaments, every second one of one, choose.

        Returns:
            The neighbours, simplified, and the environment steps of observing what new trees see.
        """
        spec, members = self._evolution.route.spec, self._hall.members
        means = np.array([self._hall.mean_of(member) for member in members])
        known = self._edited
        env_steps = _OBSERVED * sum(member.tree not in known for member in members)
        self._edited = {
            member.tree: known.get(member.tree)
            or EditedTree.of(member.tree, self._evolution.route.observe(member.tree, _OBSERVED, rng))
            for member in members
        }
        nodes = []
        for _ in range(self._config.neighbours_drawn):
            entrants = rng.integers(len(members), size=int(rng.integers(1, 3)))
            parent = members[entrants[np.argmax(means[entrants])]].tree
            nodes.append(self._edited[parent].neighbour(self._features, spec.n_actions, rng))
        return simplify_forest(stacked(nodes), spec.low, spec.high), env_steps

    def _some_members(self, rng: np.random.Generator) -> list[DecisionTree]:
        trees = [member.tree for member in self._hall.members if member.tree.n_decision_nodes > 0]
        n = min(self._config.revisits, len(trees))
        return [trees[i] for i in rng.choice(len(trees), size=n, replace=False)] if n else []

    def _refine(
        self,
        trees: Sequence[DecisionTree],
        effort: Effort,
        seeds: NDArray[np.int64],
        rng: np.random.Generator,
    ) -> tuple[int, int]:
        """Refine trees and offer what comes out; return their number and environment steps."""
        refined, env_steps = self._tuned(trees, effort, rng)
        return len(refined), env_steps + self._offer(refined, seeds)

    def _tuned(
        self, trees: Sequence[DecisionTree], effort: Effort, rng: np.random.Generator
    ) -> tuple[list[DecisionTree], int]:
        """Return what refinement makes of trees, snapped, and environment steps."""
        tuned = self._refiner.tune(trees, rng.spawn(len(trees)), effort) if trees else []
        return [self._snapped(one.tree) for one in tuned], sum(one.env_steps for one in tuned)

    def _settled(
        self, trees: Sequence[DecisionTree], seeds: NDArray[np.int64]
    ) -> tuple[list[DecisionTree], int]:
        """Return trees on the best constants near by, and environment steps."""
        grammar = self._evolution.tables.grammar
        settled = [settle(tree, grammar, lambda some: self._evolution.measure(some, seeds)) for tree in trees]
        return [tree for tree, _ in settled], sum(steps for _, steps in settled)

    def _offer(self, trees: Sequence[DecisionTree], seeds: NDArray[np.int64]) -> int:
        """Offer refined trees to the hall of fame; return the environment steps that their fitness took."""
        if not trees:
            return 0
        measured = self._evolution.measure(Forest.stack(trees), seeds)
        self._hall.offer(
            Contender(tree, float(fitness), NEIGHBOUR)
            for tree, fitness in zip(trees, measured.fitness, strict=True)
        )
        return measured.env_steps

    def _snapped(self, tree: DecisionTree) -> DecisionTree:
        if not self._snaps:
            return tree
        try:
            return snap(tree, self._evolution.tables.grammar)
        except UnencodableTreeError:
            return tree

    def _migrate(self, generation: Generation, rng: np.random.Generator) -> tuple[Generation, int]:
        """Let kept trees take the places of less fit individuals, written into the codons that are there."""
        members = self._hall.members
        slots = np.argsort(generation.fitness, kind="stable")[: self._config.migrants]
        codons, places = [], []
        for slot, member in zip(slots, rng.integers(len(members), size=len(slots)), strict=True):
            try:
                codons.append(
                    encode(
                        members[member].tree,
                        generation.codons[slot],
                        self._evolution.tables,
                        self._evolution.settings.wraps,
                    )
                )
            except UnencodableTreeError:
                continue
            places.append(slot)
        if not places:
            return generation, 0
        return self._evolution.with_places_taken(generation, np.array(places), np.stack(codons))
