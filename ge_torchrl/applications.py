"""One application of refinement: choose trees, refine each, write it back, tell what happened."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from ge_torchrl.config import Config
from ge_torchrl.records import RefinementRecord
from ge_torchrl.search.candidate import Candidate, Eligibility, choose_candidates, choose_of_each_size
from ge_torchrl.search.champion import REFINEMENT, Contender
from ge_torchrl.search.evolution import Evolution, Generation
from ge_torchrl.search.fitness import measure
from ge_torchrl.search.refinement import Refinement, RefinesTrees, refine, stream_name
from ge_torchrl.search.write_back import write_back
from ge_torchrl.seeding import stream
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.simplify import simplify_forest


@dataclass(frozen=True, eq=False)
class Applied:
    """One tree's refinement, or that there was no tree to refine.

    Attributes:
        record: What to tell.
        generation: The generation after write-back.
        refined: The refined tree if it is better than before, snapped where it is so too; else nothing.
        refinements: 1, or 0 where no candidate was found.
        seconds: Clock time.
        env_steps: Environment steps, those of write-back included.
    """

    record: RefinementRecord
    generation: Generation
    refined: tuple[Contender, ...] = ()
    refinements: int = 0
    seconds: float = 0.0
    env_steps: int = 0


def apply(
    refiner: RefinesTrees,
    config: Config,
    evolution: Evolution,
    generation: Generation,
    best: float,
    times_refined: Counter[bytes],
) -> Iterator[Applied]:
    """Refine as many trees of a generation as the configuration says, one after another.

    All candidates are chosen before any is refined, so a write-back does not change who else is refined.

    Args:
        refiner: Refines a tree.
        config: The run's configuration.
        evolution: Maps genotypes and measures trees.
        generation: The generation as it was selected.
        best: The best return or fitness that the run has seen.
        times_refined: How often each structure was refined before; what is refined here is counted in.

    Yields:
        What happened to each tree, as soon as it did.
    """
    forest = evolution.map(generation.codons).forest
    if config.refiner.simplify:
        forest = simplify_forest(forest, evolution.route.spec.low, evolution.route.spec.high)
    candidates = _candidates(config, evolution, generation, forest, times_refined)
    chance = stream(config.seed, f"chance of refinement in generation {generation.index}")
    for attempt, candidate in enumerate(candidates):
        if chance.random() >= config.refiner.probability:
            continue
        if candidate.individual is None:
            yield Applied(RefinementRecord(generation.index, "skipped", candidate.redraws), generation)
            continue
        tree = forest.tree(candidate.individual)
        times_refined[tree.structure] += 1
        name = stream_name(generation.index, attempt)
        refinement = refine(refiner, evolution.route, tree, config.refiner, config.seed, name)
        applied = _settle(config, evolution, generation, candidate, tree, refinement, best)
        generation = applied.generation
        best = max([best, *(contender.fitness for contender in applied.refined)])
        yield applied


def _candidates(
    config: Config,
    evolution: Evolution,
    generation: Generation,
    forest: Forest,
    times_refined: Counter[bytes],
) -> list[Candidate]:
    refiner = config.refiner
    eligibility = Eligibility(
        evolution.route.spec.solved_at, config.env.lowest_fitness_excluded, refiner.min_nodes
    )
    if refiner.choice == "each_size":
        return choose_of_each_size(generation.fitness, forest, eligibility, refiner.candidates, times_refined)
    return choose_candidates(
        generation.fitness,
        forest.sizes,
        eligibility,
        refiner.best_probability,
        refiner.candidates,
        stream(config.seed, f"candidate in generation {generation.index}"),
    )


def _settle(
    config: Config,
    evolution: Evolution,
    generation: Generation,
    candidate: Candidate,
    tree: DecisionTree,
    refinement: Refinement,
    best: float,
) -> Applied:
    """Write a refined tree back, if that is asked for and there is one, and record what happened."""
    individual = candidate.individual
    after, return_snapped, env_steps = generation, None, refinement.env_steps
    refined = Contender(refinement.tree, refinement.return_after, REFINEMENT)
    if config.refiner.write_back and individual is not None and refinement.training.failure is None:
        written = write_back(evolution, generation, individual, refinement.tree)
        after, env_steps = written.generation, env_steps + written.env_steps
        if written.tree is not None:
            snapped = measure(evolution.route, Forest.stack([written.tree]), refinement.measuring_seeds)
            return_snapped, env_steps = float(snapped.fitness[0]), env_steps + snapped.env_steps
            if return_snapped > refinement.return_before:
                # What the grammar can say is what a person reads with ease.
                refined = Contender(written.tree, return_snapped, REFINEMENT)
    return Applied(
        record=_record(
            generation,
            candidate,
            tree,
            refinement,
            best,
            return_snapped=return_snapped,
            written_back=after is not generation,
        ),
        generation=after,
        refined=(refined,) * refinement.is_improved,
        refinements=1,
        seconds=refinement.seconds,
        env_steps=env_steps,
    )


def _record(
    generation: Generation,
    candidate: Candidate,
    tree: DecisionTree,
    refinement: Refinement,
    best: float,
    *,
    return_snapped: float | None,
    written_back: bool,
) -> RefinementRecord:
    individual = candidate.individual if candidate.individual is not None else -1
    training = refinement.training
    return RefinementRecord(
        generation=generation.index,
        outcome=refinement.outcome,
        chosen=candidate.chosen,
        redraws=candidate.redraws,
        individual=candidate.individual,
        decision_nodes=tree.n_decision_nodes,
        fitness_before=float(generation.fitness[individual]),
        return_before=refinement.return_before,
        soft_return=_finite_or_none(training.soft_return),
        return_after=refinement.return_after,
        new_best=refinement.is_improved and refinement.return_after > best,
        thresholds_moved=refinement.thresholds_moved,
        largest_threshold_move=refinement.largest_threshold_move,
        leaves_changed=refinement.leaves_changed,
        timesteps=training.timesteps,
        updates=training.updates,
        gradient_steps=training.gradient_steps,
        actor_loss=_finite_or_none(training.actor_loss),
        critic_loss=_finite_or_none(training.critic_loss),
        clip_fraction=_finite_or_none(training.clip_fraction),
        kl=_finite_or_none(training.kl),
        failure=training.failure,
        refine_seconds=refinement.seconds,
        return_snapped=return_snapped,
        written_back=written_back,
    )


def _finite_or_none(value: float) -> float | None:
    # What was never measured is not a number, which JSON has no word for.
    return value if math.isfinite(value) else None
