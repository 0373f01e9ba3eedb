"""Refinement of a generation's proposals: one batch through the refiner, one through the polish, each measured once.

A refiner's result is accepted only where it is clearly better than its source on episodes that nothing was trained
on. What is left is polished without gradients, snapped to the grammar's constants, and measured on the generation's
training episodes, on the scale of the population.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.errors import UnencodableTreeError
from ge_torchrl.ge.encoding import snap
from ge_torchrl.refiners.protocol import Effort, Refined, Refiner, TrainingRecord
from ge_torchrl.search.fitness import fitness_of, measure, training_seeds
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.proposals import Proposal
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

IMPROVED, NOT_IMPROVED, FAILED = "improved", "not_improved", "failed"
"""The outcomes of a refinement."""
MEASURING = "measuring"
"""The purpose that steps of acceptance and of measuring refined trees are counted under."""
CLEARLY = 3.0
"""Standard errors by which a refined tree has to be better; two let a worse one pass (docs/trials.md)."""


@dataclass(frozen=True, eq=False)
class Refinement:
    """One proposal before and after its refinement.

    Attributes:
        proposal: What was refined.
        refined: What the refiner made of it and acceptance left: the proposal's own tree where nothing was accepted, or
            where the refiner was not due.
        tree: What is left after polish and snapping; what is offered and written back.
        fitness: Of `tree`, on the generation's training episodes.
        training: What the refiner reports; None where it was not due, or a limit left no room.
        outcome: IMPROVED where `refined` is fitter than the proposal's tree on the measuring episodes, NOT_IMPROVED, or
            FAILED; None where the refiner was not due.
        fitness_before: Of the proposal's tree on the measuring episodes; NaN where the refiner was not due.
        fitness_after: Of `refined` on them.
        snapped: `refined` on the grammar's constants; None where it is not snapped, or cannot be.
        fitness_snapped: Of `snapped` on them.
        seconds: Clock time of the refiner, shared out evenly over its batch.
    """

    proposal: Proposal
    refined: DecisionTree
    tree: DecisionTree
    fitness: float
    training: TrainingRecord | None = None
    outcome: str | None = None
    fitness_before: float = math.nan
    fitness_after: float = math.nan
    snapped: DecisionTree | None = None
    fitness_snapped: float | None = None
    seconds: float = 0.0

    @property
    def is_changed(self) -> bool:
        """Whether anything changed the tree."""
        return self.tree != self.proposal.tree


@dataclass(frozen=True, eq=False)
class Refinements:
    """What became of a generation's proposals.

    Attributes:
        refinements: In the order of the proposals.
        polished: Trees that were polished.
        polish_seconds: Clock time of it.
    """

    refinements: tuple[Refinement, ...] = ()
    polished: int = 0
    polish_seconds: float = 0.0


def refine_proposals(problem: Problem, proposals: Sequence[Proposal], generation: int) -> Refinements:
    """Refine and polish a generation's proposals, as far as either is due.

    Args:
        problem: What is searched.
        proposals: The proposals, in an order that is a function of configuration and seed.
        generation: Number of the generation.
    """
    if not proposals:
        return Refinements()
    started = [Refinement(proposal, proposal.tree, proposal.tree, proposal.fitness) for proposal in proposals]
    if problem.refiner is not None and problem.refines_in(generation):
        started = _refined(problem, problem.refiner, started, generation)
    polish_started = time.perf_counter()
    trees = [refinement.refined for refinement in started]
    polished = 0
    if problem.polisher is not None and problem.polishes_in(generation):
        trees = _tuned(problem, problem.polisher, started, trees, f"polish, generation {generation}")
        polished = len(trees)
    polish_seconds = time.perf_counter() - polish_started if polished else 0.0
    if snaps(problem):
        trees = [snapped(problem, tree) for tree in trees]
    fitness = measure(
        problem.backend,
        Forest.stack(trees),
        training_seeds(problem.config, generation),
        MEASURING,
        problem.config.evaluation.std_penalty,
    )
    return Refinements(
        tuple(
            replace(refinement, tree=tree, fitness=float(value))
            for refinement, tree, value in zip(started, trees, fitness, strict=True)
        ),
        polished,
        polish_seconds,
    )


def snaps(problem: Problem) -> bool:
    """Tell whether refined trees are kept on the grammar's constants: not where the end rounds them by their return."""
    return problem.config.refiner.write_back and not problem.rounds


def snapped(problem: Problem, tree: DecisionTree) -> DecisionTree:
    """Return a tree on the grammar's constants; as it is where the grammar has none for it."""
    return _on_constants(problem, tree) or tree


def _on_constants(problem: Problem, tree: DecisionTree) -> DecisionTree | None:
    try:
        return snap(tree, problem.tables.grammar)
    except UnencodableTreeError:
        return None


def is_clearly_better(returns: NDArray[np.float64], than: NDArray[np.float64], errors: float) -> bool:
    """Tell whether a tree returns more than another by so many standard errors of the mean difference.

    With the differences d_e of `E` episodes and k errors: `mean(d) > k std(d) / sqrt(E)`.

    Args:
        returns: [E] of the tree.
        than: [E] of the other on the same episodes.
        errors: k, at least 0.
    """
    difference = returns - than
    return bool(difference.mean() > errors * difference.std() / math.sqrt(len(difference)))


def _tuned(
    problem: Problem,
    refiner: Refiner,
    refinements: Sequence[Refinement],
    trees: Sequence[DecisionTree],
    name: str,
) -> list[DecisionTree]:
    return [one.tree for one in _batches(problem, refiner, refinements, trees, name)]


def _batches(
    problem: Problem,
    refiner: Refiner,
    refinements: Sequence[Refinement],
    trees: Sequence[DecisionTree],
    name: str,
) -> list[Refined]:
    """Refine trees, those of one effort in one call; each has a stream of its own, found by its place."""
    results: dict[int, Refined] = {}
    efforts = dict.fromkeys(refinement.proposal.effort for refinement in refinements)
    for effort in efforts:
        places = [i for i, refinement in enumerate(refinements) if refinement.proposal.effort == effort]
        rngs = [stream(problem.config.seed, f"{name}, proposal {i}") for i in places]
        refined = refiner.refine([trees[i] for i in places], rngs, effort)
        results.update(zip(places, refined, strict=True))
    return [results[i] for i in range(len(trees))]


def _refined(
    problem: Problem, refiner: Refiner, refinements: list[Refinement], generation: int
) -> list[Refinement]:
    """Return the refinements after the refiner and acceptance, measured before and after on unseen episodes."""
    started = time.perf_counter()
    trees = [refinement.proposal.tree for refinement in refinements]
    name = f"refinement, generation {generation}"
    results = _batches(problem, refiner, refinements, trees, name)
    accepted = _accepted(problem, trees, [one.tree for one in results], generation)
    settings = problem.config.refiner
    on_constants = [_on_constants(problem, tree) if settings.write_back else None for tree in accepted]
    rng = stream(problem.config.seed, f"measuring, generation {generation}")
    fitness = measure(
        problem.backend,
        Forest.stack([*trees, *accepted, *(tree for tree in on_constants if tree is not None)]),
        episode_seeds("training", settings.measuring_episodes, rng),
        MEASURING,
        problem.config.evaluation.std_penalty,
    ).tolist()
    n, seconds = len(trees), (time.perf_counter() - started) / len(trees)
    of_snapped = iter(fitness[2 * n :])
    return [
        replace(
            refinement,
            refined=accepted[i],
            tree=accepted[i],
            training=results[i].training,
            outcome=_outcome(results[i].training, fitness[i], fitness[n + i]),
            fitness_before=fitness[i],
            fitness_after=fitness[n + i],
            snapped=on_constants[i],
            fitness_snapped=None if on_constants[i] is None else next(of_snapped),
            seconds=seconds,
        )
        for i, refinement in enumerate(refinements)
    ]


def _accepted(
    problem: Problem, before: Sequence[DecisionTree], after: Sequence[DecisionTree], generation: int
) -> list[DecisionTree]:
    """Return each refined tree where it is clearly better on unseen episodes, else the tree as it was."""
    settings = problem.config.refiner
    changed = [i for i, (old, new) in enumerate(zip(before, after, strict=True)) if old != new]
    if settings.acceptance_episodes == 0 or not changed:
        return list(after)
    rng = stream(problem.config.seed, f"acceptance, generation {generation}")
    outcomes = problem.backend.evaluate(
        Forest.stack([*(before[i] for i in changed), *(after[i] for i in changed)]),
        episode_seeds("training", settings.acceptance_episodes, rng),
        MEASURING,
    )
    old_returns, new_returns = np.split(outcomes.returns, 2)
    better = {
        i
        for i, old, new in zip(changed, old_returns, new_returns, strict=True)
        if is_clearly_better(new, old, CLEARLY) and _is_fitter(problem, new, old)
    }
    return [new if i in better else old for i, (old, new) in enumerate(zip(before, after, strict=True))]


def _is_fitter(problem: Problem, new: NDArray[np.float64], old: NDArray[np.float64]) -> bool:
    fitness = fitness_of(np.stack([new, old]), problem.config.evaluation.std_penalty)
    return bool(fitness[0] > fitness[1])


def _outcome(training: TrainingRecord | None, before: float, after: float) -> str | None:
    if training is None:
        return None
    if training.failure is not None:
        return FAILED
    return IMPROVED if after > before else NOT_IMPROVED


def refine_with_effort(
    problem: Problem, refiner: Refiner, trees: Sequence[DecisionTree], effort: Effort, name: str
) -> list[DecisionTree]:
    """Return what a refiner makes of trees, snapped where refined trees are kept so.

    Args:
        problem: What is searched.
        refiner: The method.
        trees: The trees.
        effort: How much is spent on each.
        name: Of the streams of randomness.
    """
    rngs = [stream(problem.config.seed, f"{name}, tree {i}") for i in range(len(trees))]
    tuned = [one.tree for one in refiner.refine(trees, rngs, effort)]
    return [snapped(problem, tree) for tree in tuned] if snaps(problem) else tuned
