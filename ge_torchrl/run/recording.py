"""From what happens in a search to the records that a run leaves."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from ge_torchrl.artefacts.memory import Artefacts
from ge_torchrl.artefacts.records import ArchiveRecord, GenerationRecord, RefinementRecord, Summary
from ge_torchrl.config import Config
from ge_torchrl.run.closing import tree_text
from ge_torchrl.run.episodes import AFTER_SEARCH
from ge_torchrl.search.archive import Archive, Contender, Member
from ge_torchrl.search.conclusion import Verdict, train_fitness_of
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.proposals import INDIVIDUAL
from ge_torchrl.search.state import Events, RefinementEvent, SearchState
from ge_torchrl.trees.complexity import complexity
from ge_torchrl.trees.controller import Controller, Names
from ge_torchrl.trees.tree import DecisionTree
from ge_torchrl.version import __version__


def generation_record(
    state: SearchState, events: Events, env_steps: int, elapsed_seconds: float
) -> GenerationRecord:
    """Return the line of the history for a generation."""
    population = state.population
    valid = population.fitness[np.isfinite(population.fitness)]
    return GenerationRecord(
        generation=state.generation,
        best_fitness=float(valid.max()) if len(valid) else None,
        best_refined=state.best_refined.fitness if state.best_refined else None,
        median_fitness=float(np.median(valid)) if len(valid) else None,
        mean_fitness=float(valid.mean()) if len(valid) else None,
        best_decision_nodes=int(population.sizes[population.best]) if len(valid) else None,
        born=events.born,
        invalid=events.invalid,
        env_steps=env_steps,
        elapsed_seconds=elapsed_seconds,
        evaluation_seconds=events.evaluation_seconds,
        variation_seconds=events.variation_seconds,
        refined=state.counts.refined,
        polished=state.counts.polished,
    )


def best_by_nodes(archive: Archive) -> dict[int, float]:
    """Return the fitness of the best kept tree of each number of decision nodes, from small to large."""
    best: dict[int, float] = {}
    for member in archive.members:
        best.setdefault(member.tree.num_decision_nodes, member.archive_fitness)
    return best


def refinement_records(state: SearchState, events: Events) -> list[RefinementRecord]:
    """Return a record for each tree that the refiner refined, or for that no candidate was found."""
    records = [_refinement_record(state.generation, event) for event in events.refinements]
    if events.redraws is not None:
        records.insert(0, RefinementRecord(state.generation, "skipped", redraws=events.redraws))
    return records


def _refinement_record(generation: int, event: RefinementEvent) -> RefinementRecord:
    one, proposal, training = event.refinement, event.refinement.proposal, event.refinement.training
    before, after = proposal.tree, one.refined
    moves = np.abs(after.parameters.astype(np.float64) - before.parameters)
    is_individual = proposal.origin == INDIVIDUAL
    told: dict[str, Any] = {} if training is None else asdict(training)
    return RefinementRecord(
        generation=generation,
        outcome=one.outcome or "",
        origin=proposal.origin,
        redraws=proposal.redraws,
        chosen=proposal.chosen if is_individual else None,
        individual=proposal.individual,
        decision_nodes=before.num_decision_nodes,
        fitness_before=proposal.fitness,
        return_before=one.fitness_before,
        return_after=one.fitness_after,
        return_snapped=one.fitness_snapped,
        written_back=event.written_back,
        new_best=event.new_best,
        parameters_moved=int(np.count_nonzero(moves)),
        largest_parameter_move=float(moves.max(initial=0.0)),
        leaves_changed=int(np.count_nonzero(after.action != before.action)),
        refine_seconds=one.seconds,
        **{name: _finite_or_none(value) for name, value in told.items()},
    )


def _finite_or_none(value: Any) -> Any:
    # What was never measured is not a number, which JSON has no word for.
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_verdict(config: Config, names: Names, folder: Artefacts, verdict: Verdict) -> list[ArchiveRecord]:
    """Write the champion and the best tree of each size, with what validation and test said of them.

    Returns:
        The table by size, from small to large.
    """
    champion = verdict.champion
    told = {
        "train_fitness": champion.train_fitness,
        "validation_mean": float(champion.validation_returns.mean()),
        "test_mean": float(verdict.test_returns.mean()),
        "test_mean_full": float(verdict.test_returns_full.mean()),
    }
    write_champion(config, names, folder, champion.pruned, champion.full, told)
    records = [
        ArchiveRecord(
            decision_nodes=one.pruned.num_decision_nodes,
            depth=one.pruned.depth,
            complexity_M=complexity(one.pruned).M,
            archive_mean=one.archive_fitness,
            validation_mean=float(one.validation_returns.mean()),
            test_mean=_finite_or_none(float(returns.mean())),
            test_std=_finite_or_none(float(returns.std())),
            origin=one.origin,
        )
        for one, returns in zip(verdict.by_size, verdict.test_returns_by_size, strict=True)
    ]
    if records:
        trees = [one.pruned for one in verdict.by_size]
        _write_archive(config, names, folder, records, trees)
    return records


def write_untested(
    config: Config, names: Names, folder: Artefacts, best: Contender | Member, archive: Archive
) -> None:
    """Write the best tree so far and the kept trees as they are: something ended the run before validation."""
    told = {"train_fitness": train_fitness_of(best), "test_mean": None}
    write_champion(config, names, folder, best.tree, best.tree, told)
    sizes = sorted({member.tree.num_decision_nodes for member in archive.members})
    members = [archive.of_size(size)[0] for size in sizes]
    records = [
        ArchiveRecord(
            decision_nodes=member.tree.num_decision_nodes,
            depth=member.tree.depth,
            complexity_M=complexity(member.tree).M,
            archive_mean=member.archive_fitness,
            validation_mean=None,
            test_mean=None,
            test_std=None,
            origin=member.origin,
        )
        for member in members
    ]
    if records:
        _write_archive(config, names, folder, records, [member.tree for member in members])


def write_champion(
    config: Config,
    names: Names,
    folder: Artefacts,
    pruned: DecisionTree,
    full: DecisionTree,
    told: Mapping[str, object],
) -> None:
    """Write the champion, pruned and as it was."""
    origin = {**_provenance(config), **told}
    controller = Controller(pruned, names, {**origin, "pruned": True})
    folder.write_trees(
        controller, Controller(full, names, {**origin, "pruned": False}), tree_text(controller)
    )


def _write_archive(
    config: Config,
    names: Names,
    folder: Artefacts,
    records: Sequence[ArchiveRecord],
    trees: Sequence[DecisionTree],
) -> None:
    controllers = [
        Controller(tree, names, {**_provenance(config), **asdict(record), "pruned": True})
        for tree, record in zip(trees, records, strict=True)
    ]
    folder.write_archive(list(zip(records, controllers, strict=True)))


def _provenance(config: Config) -> dict[str, object]:
    return {
        "program": f"ge_torchrl {__version__}",
        "seed": config.seed,
        "grammar": config.grammar.name,
    }


def summary_of(
    problem: Problem,
    state: SearchState,
    verdict: Verdict,
    stopped_by: str,
    warnings: Sequence[str],
    spent: Mapping[str, float],
) -> Summary:
    """Return the summary of a run.

    Args:
        problem: What was searched.
        state: The last state.
        verdict: What the search ended with.
        stopped_by: What stopped it.
        warnings: What the user was warned of.
        spent: The fields of the summary that are clock time [s].
    """
    config, backend, counts, champion = problem.config, problem.backend, state.counts, verdict.champion
    spec, steps = backend.spec, dict(sorted(backend.steps.items()))
    test_mean = float(verdict.test_returns.mean())
    return Summary(
        environment=spec.id,
        seed=config.seed,
        solved=None if spec.solved_at is None else spec.is_solved(test_mean),
        train_fitness=champion.train_fitness,
        validation_mean=float(champion.validation_returns.mean()),
        test_mean=test_mean,
        test_std=float(verdict.test_returns.std()),
        test_episodes=len(verdict.test_returns),
        test_mean_full=float(verdict.test_returns_full.mean()),
        decision_nodes=champion.pruned.num_decision_nodes,
        depth=champion.pruned.depth,
        complexity_M=complexity(champion.pruned).M,
        generations=state.generation + 1,
        stopped_by=stopped_by,
        env_steps=sum(n for purpose, n in steps.items() if purpose not in AFTER_SEARCH),
        steps=steps,
        steps_per_second=config.evaluation.steps_per_second or backend.steps_per_second,
        refinements=counts.refinements,
        refinements_improved=counts.improved,
        refined=counts.refined,
        polished=counts.polished,
        champion_from=champion.origin,
        invalid_fraction=counts.invalid / counts.born,
        route=backend.name,
        solved_at=spec.solved_at,
        version=__version__,
        warnings=tuple(warnings),
        workers=backend.processes,
        sampling_workers=backend.sampling_processes or None,
        **spent,
    )
