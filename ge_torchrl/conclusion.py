"""The end of a run: choose the champion and the best tree of each size, prune, test, write."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import NamedTuple

from ge_torchrl import __version__
from ge_torchrl.artefacts import RunFolder
from ge_torchrl.config import Config
from ge_torchrl.environments.route import Outcomes
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.errors import GrammarError
from ge_torchrl.generations import Evolved
from ge_torchrl.leader import validation_seeds
from ge_torchrl.records import HallOfFameRecord, Summary
from ge_torchrl.report.closing import tree_text
from ge_torchrl.search.champion import Champion, Contender, choose_champion, contenders_of
from ge_torchrl.search.evolution import Evolution
from ge_torchrl.search.hall_of_fame import HallOfFame, Winners
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.complexity import complexity
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.labels import TreeLabels
from ge_torchrl.trees.serialization import TreeDocument
from ge_torchrl.trees.simplify import simplify_exact


def conclude(
    config: Config,
    evolution: Evolution,
    evolved: Evolved,
    hall: HallOfFame | None,
    folder: RunFolder,
    started: float,
) -> tuple[Summary, Champion, list[HallOfFameRecord]]:
    """Choose the champion, prune it, test it on unseen episodes and write what was found.

    Args:
        config: The run's configuration.
        evolution: What made the generations.
        evolved: How far it came.
        hall: The hall of fame, or None where none is kept.
        folder: Where everything is written.
        started: When the run began, by the clock.

    Returns:
        The summary, the champion, and the best tree of each size: none without a hall of fame.

    Raises:
        GrammarError: There is no tree to choose from.
    """
    route = evolution.route
    contenders = _contenders(config, evolution, evolved)
    # Testing can take long where environments are slow: whatever happens to it, a tree is there.
    _save_leader(config, route.spec, contenders, folder)
    champion = choose_champion(
        route,
        contenders,
        config.evaluation.champion_candidates,
        validation_seeds(config),
        hall.members if hall else (),
    )
    test_seeds = episode_seeds("test", config.evaluation.test_episodes, stream(config.seed, "test episodes"))
    tested = route.evaluate(Forest.stack([champion.pruned, champion.full]), test_seeds)
    steps = evolved.validation_env_steps + champion.env_steps + tested.env_steps
    best_by_size: list[HallOfFameRecord] = []
    if hall:
        winners = hall.choose_winners(champion, validation_seeds(config))
        outcomes = route.evaluate(Forest.stack([winner.tree for winner in winners.by_size]), test_seeds)
        steps += hall.env_steps - evolved.hall_env_steps + winners.env_steps + outcomes.env_steps
        best_by_size = _write_hall_of_fame(config, route.spec.labels, winners, outcomes, folder)
    summary = _summary(config, route.spec, evolved, champion, tested, _Effort(route.name, steps, started))
    told = {
        "validation_mean": summary.validation_mean,
        "test_mean": summary.test_mean,
        "test_mean_full": summary.test_mean_full,
    }
    _write_trees(
        config, route.spec.labels, folder, champion.full, champion.pruned, summary.train_fitness, told
    )
    folder.write_summary(summary)
    return summary, champion, best_by_size


class _Effort(NamedTuple):
    """What concluding a run took.

    Attributes:
        route: The route's name.
        steps: Environment steps after evolution.
        started: When the run began, by the clock.
    """

    route: str
    steps: int
    started: float


def _summary(
    config: Config,
    spec: EnvironmentSpec,
    evolved: Evolved,
    champion: Champion,
    tested: Outcomes,
    effort: _Effort,
) -> Summary:
    returns = tested.returns[0]
    return Summary(
        environment=spec.id,
        seed=config.seed,
        solved=None if spec.solved_at is None else spec.is_solved(float(returns.mean())),
        train_fitness=champion.train_fitness,
        validation_mean=champion.validation_mean,
        test_mean=float(returns.mean()),
        test_std=float(returns.std()),
        test_episodes=len(returns),
        test_mean_full=float(tested.returns[1].mean()),
        decision_nodes=champion.pruned.n_decision_nodes,
        depth=champion.pruned.depth,
        complexity_M=complexity(champion.pruned).M,
        generations=evolved.last.index + 1,
        stopped_by=evolved.stopped_by,
        env_steps=evolved.env_steps,
        env_steps_total=evolved.env_steps + effort.steps,
        refinements=evolved.refinements,
        refinements_improved=len(evolved.refined),
        champion_from=champion.origin,
        evolve_seconds=evolved.seconds,
        refine_seconds=evolved.refine_seconds,
        wall_seconds=time.perf_counter() - effort.started,
        invalid_fraction=evolved.invalid / evolved.born,
        route=effort.route,
        solved_at=spec.solved_at,
        version=__version__,
        explored=evolved.explored,
        explore_seconds=evolved.explore_seconds,
    )


def _write_hall_of_fame(
    config: Config, labels: TreeLabels, winners: Winners, tested: Outcomes, folder: RunFolder
) -> list[HallOfFameRecord]:
    """Write the best tree of each size and what the test said of it; return the table."""
    records = [
        HallOfFameRecord(
            decision_nodes=winner.tree.n_decision_nodes,
            depth=winner.tree.depth,
            complexity_M=complexity(winner.tree).M,
            archive_mean=winner.archive_mean,
            validation_mean=winner.validation_mean,
            test_mean=float(returns.mean()),
            test_std=float(returns.std()),
            origin=winner.origin,
        )
        for winner, returns in zip(winners.by_size, tested.returns, strict=True)
    ]
    documents = [
        TreeDocument(winner.tree, labels, {**_provenance(config), **asdict(record), "pruned": True})
        for winner, record in zip(winners.by_size, records, strict=True)
    ]
    folder.write_hall_of_fame(list(zip(records, documents, strict=True)))
    return records


def save_untested(config: Config, evolution: Evolution, evolved: Evolved, folder: RunFolder) -> None:
    """Write the best tree so far, untested: a fault ended the run.

    Raises:
        GrammarError: There is no tree.
    """
    _save_leader(config, evolution.route.spec, _contenders(config, evolution, evolved), folder)


def _contenders(config: Config, evolution: Evolution, evolved: Evolved) -> list[Contender]:
    mapping = evolution.map(evolved.last.codons)
    contenders = [*contenders_of(mapping, evolved.last.fitness), *evolved.refined]
    if not contenders:
        raise GrammarError(
            f"no genotype of {config.ge.genotype_length} codons gave a tree in {evolved.born} tries; "
            f"the grammar {config.grammar.name} needs a longer one (ge.genotype_length) or wraps (ge.wraps)"
        )
    return contenders


def _save_leader(
    config: Config, spec: EnvironmentSpec, contenders: Sequence[Contender], folder: RunFolder
) -> None:
    """Write the fittest tree as it is, untested, without the splits that no state can reach."""
    leader = max(contenders, key=lambda contender: contender.fitness)
    simple = simplify_exact(leader.tree, spec.low, spec.high)
    _write_trees(config, spec.labels, folder, leader.tree, simple, leader.fitness, {"test_mean": None})


def _write_trees(
    config: Config,
    labels: TreeLabels,
    folder: RunFolder,
    full: DecisionTree,
    pruned: DecisionTree,
    train_fitness: float,
    told: Mapping[str, object],
) -> None:
    origin = {**_provenance(config), "train_fitness": train_fitness, **told}
    folder.write_trees(
        TreeDocument(pruned, labels, {**origin, "pruned": True}),
        TreeDocument(full, labels, {**origin, "pruned": False}),
        tree_text(pruned, labels),
    )


def _provenance(config: Config) -> dict[str, object]:
    return {
        "program": f"ge_torchrl {__version__}",
        "seed": config.seed,
        "grammar": config.grammar.name,
    }
