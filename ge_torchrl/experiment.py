"""A run from configuration to verdict: describe, evolve, choose, prune, test, write, tell."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from rich.console import Console

from ge_torchrl import __version__
from ge_torchrl.artefacts import RunFolder
from ge_torchrl.compilation import is_compiled_before
from ge_torchrl.config import Config
from ge_torchrl.environments.choose import open_route
from ge_torchrl.environments.route import Route
from ge_torchrl.environments.spec import EnvironmentSpec, describe
from ge_torchrl.errors import ConfigError, EnvironmentFaultError, GrammarError
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.rule_tables import RuleTables, compile_rules
from ge_torchrl.generations import Evolved, GenerationLoop, validation_seeds
from ge_torchrl.records import Summary
from ge_torchrl.report.closing import closing_text, tree_text
from ge_torchrl.report.progress import Progress
from ge_torchrl.search.champion import Champion, Contender, choose_champion, contenders_of
from ge_torchrl.search.evolution import Evolution
from ge_torchrl.search.fitness import TrainingEpisodes
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.complexity import complexity
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.serialization import TreeDocument
from ge_torchrl.trees.simplify import simplify_exact

if TYPE_CHECKING:
    from ge_torchrl.search.refinement import RefinesTrees

_Record = TypeVar("_Record")


@dataclass(frozen=True, eq=False)
class Plan:
    """A configuration made real: what can be known to be right before anything is written.

    Attributes:
        config: The configuration.
        spec: The environment.
        tables: The compiled grammar.
    """

    config: Config
    spec: EnvironmentSpec
    tables: RuleTables


def plan(config: Config) -> Plan:
    """Check what a configuration promises: that the environment exists and fits, and that the grammar is one.

    Raises:
        EnvironmentFaultError: The environment is unknown or unsuitable, or has no such route.
        GrammarError: The grammar text breaks a rule.
        ConfigError: The method of refinement is not installed.
    """
    if config.ppo.enabled and config.ppo.method == "cmaes" and find_spec("cma") is None:
        raise ConfigError(
            'ppo.method must be ppo where pycma is missing; got cmaes (pip install "ge-torchrl[cmaes]")'
        )
    env = config.env
    spec = describe(env.id, env.features, env.units, env.actions, env.solved_at, env.max_episode_steps)
    if env.route == "compiled":
        open_route(spec, env.route, threads=1).close()
    grammar = read_grammar(config.grammar.bnf, spec.labels.features, spec.labels.actions)
    return Plan(config, spec, compile_rules(grammar, single_choice_consumes=config.ge.single_choice_consumes))


def run(config: Config, output_dir: Path, console: Console | None = None) -> Summary:
    """Run an experiment and leave its artefacts in a folder.

    Args:
        config: Everything the run depends on.
        output_dir: The run folder, made if need be.
        console: Where progress goes; standard output if not given.

    Returns:
        The summary, as it is in the folder.

    Raises:
        UserError: The configuration cannot be run, or the environment failed on the way.
    """
    started = time.perf_counter()
    planned = plan(config)
    console = console or Console(highlight=False)
    route = open_route(planned.spec, config.env.route, config.evaluation.threads, config.env.workers)
    try:
        folder = RunFolder.create(output_dir, config)
        console.print(
            f"{planned.spec.id}, seed {config.seed}: {config.ge.generations} generations of "
            f"{config.ge.population_size} trees, {config.evaluation.episodes} episodes each, {route.name} route",
            soft_wrap=True,
        )
        evolution = Evolution(
            config.ge,
            planned.tables,
            route,
            TrainingEpisodes(
                config.evaluation.episode_seeds,
                config.evaluation.episodes,
                stream(config.seed, "training episodes"),
            ),
            stream(config.seed, "evolution"),
        )
        if not is_compiled_before():
            console.print("Compiling the kernels for this machine, once; this takes some seconds ...")
        evolution.warm_up()
        evolved = _evolve(planned, evolution, folder, console)
        if evolved.stopped_by == "interrupt":
            console.print("Testing what was found; Ctrl-C again leaves it untested in the run folder.")
        summary, champion = _conclude(planned, evolution, evolved, folder, started)
    finally:
        route.close()
    console.print()
    shown = folder.path.relative_to(Path.cwd()) if folder.path.is_relative_to(Path.cwd()) else folder.path
    console.print(closing_text(summary, champion.pruned, planned.spec.labels, shown), soft_wrap=True)
    return summary


def _evolve(planned: Plan, evolution: Evolution, folder: RunFolder, console: Console) -> Evolved:
    """Run the loop over generations with its files and its progress; a fault keeps the best tree so far."""
    config = planned.config
    with ExitStack() as open_files:
        history = open_files.enter_context(folder.history_writer())
        progress = open_files.enter_context(Progress(console, config.ge.generations))
        loop = GenerationLoop(config, evolution, on_generation=_each(history.write, progress.show))
        if config.ppo.enabled:
            refinements = open_files.enter_context(folder.refinements_writer())
            refiner = _make_refiner(config, evolution.route)
            loop.refine_with(refiner, _each(refinements.write, progress.show_refinement))
        try:
            return loop.run()
        except EnvironmentFaultError as fault:
            if loop.evolved is None:
                raise
            _save_leader(planned, _contenders(planned, evolution, loop.evolved), folder)
            raise EnvironmentFaultError(
                f"{fault}; the best tree so far is in {folder.path}, untested"
            ) from fault


def _each(*receivers: Callable[[_Record], None]) -> Callable[[_Record], None]:
    def receive(record: _Record) -> None:
        for receiver in receivers:
            receiver(record)

    return receive


def _make_refiner(config: Config, route: Route) -> RefinesTrees:
    # torch takes two seconds to import, which grammatical evolution alone need not pay.
    if config.ppo.method == "cmaes":
        from ge_torchrl.search.cmaes import CMAESRefiner

        return CMAESRefiner(route, config.ppo, config.seed)
    from ge_torchrl.search.refinement import Refiner

    return Refiner(route, config.ppo, config.seed)


def _conclude(
    planned: Plan, evolution: Evolution, evolved: Evolved, folder: RunFolder, started: float
) -> tuple[Summary, Champion]:
    """Choose the champion, prune it, test it on unseen episodes and write what was found."""
    config, spec, route = planned.config, planned.spec, evolution.route
    contenders = _contenders(planned, evolution, evolved)
    # Testing can take long where environments are slow: whatever happens to it, a tree is there.
    _save_leader(planned, contenders, folder)
    champion = choose_champion(
        route, contenders, config.evaluation.champion_candidates, validation_seeds(config)
    )
    test_seeds = episode_seeds("test", config.evaluation.test_episodes, stream(config.seed, "test episodes"))
    tested = route.evaluate(Forest.stack([champion.pruned, champion.full]), test_seeds)
    returns = tested.returns[0]
    summary = Summary(
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
        env_steps_total=evolved.env_steps + champion.env_steps + tested.env_steps,
        refinements=evolved.refinements,
        refinements_improved=len(evolved.refined),
        champion_from=champion.origin,
        evolve_seconds=evolved.seconds,
        refine_seconds=evolved.refine_seconds,
        wall_seconds=time.perf_counter() - started,
        invalid_fraction=evolved.invalid / evolved.born,
        route=route.name,
        solved_at=spec.solved_at,
        version=__version__,
    )
    told = {
        "validation_mean": summary.validation_mean,
        "test_mean": summary.test_mean,
        "test_mean_full": summary.test_mean_full,
    }
    _write_trees(planned, folder, champion.full, champion.pruned, summary.train_fitness, told)
    folder.write_summary(summary)
    return summary, champion


def _contenders(planned: Plan, evolution: Evolution, evolved: Evolved) -> list[Contender]:
    mapping = evolution.map(evolved.last.codons)
    contenders = [*contenders_of(mapping, evolved.last.fitness), *evolved.refined]
    if not contenders:
        config = planned.config
        raise GrammarError(
            f"no genotype of {config.ge.genotype_length} codons gave a tree in {evolved.born} tries; "
            f"the grammar {config.grammar.name} needs a longer one (ge.genotype_length) or wraps (ge.wraps)"
        )
    return contenders


def _save_leader(planned: Plan, contenders: Sequence[Contender], folder: RunFolder) -> None:
    """Write the fittest tree as it is, untested, without the splits that no state can reach."""
    leader = max(contenders, key=lambda contender: contender.fitness)
    simple = simplify_exact(leader.tree, planned.spec.low, planned.spec.high)
    _write_trees(planned, folder, leader.tree, simple, leader.fitness, {"test_mean": None})


def _write_trees(
    planned: Plan,
    folder: RunFolder,
    full: DecisionTree,
    pruned: DecisionTree,
    train_fitness: float,
    told: Mapping[str, object],
) -> None:
    labels = planned.spec.labels
    origin = {
        "program": f"ge_torchrl {__version__}",
        "seed": planned.config.seed,
        "grammar": planned.config.grammar.name,
        "train_fitness": train_fitness,
        **told,
    }
    folder.write_trees(
        TreeDocument(pruned, labels, {**origin, "pruned": True}),
        TreeDocument(full, labels, {**origin, "pruned": False}),
        tree_text(pruned, labels),
    )
