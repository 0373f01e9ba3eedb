"""A run from configuration to verdict: describe, evolve, choose, prune, test, write, tell."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from rich.console import Console

from ge_torchrl.artefacts import RunFolder
from ge_torchrl.compilation import is_compiled_before
from ge_torchrl.conclusion import conclude, save_untested
from ge_torchrl.config import Config
from ge_torchrl.environments.choose import open_route
from ge_torchrl.environments.route import Route
from ge_torchrl.environments.spec import EnvironmentSpec, describe
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.rule_tables import RuleTables, compile_rules
from ge_torchrl.generations import Evolved, GenerationLoop
from ge_torchrl.records import Summary
from ge_torchrl.report.closing import closing_text
from ge_torchrl.report.progress import Progress
from ge_torchrl.search.evolution import Evolution
from ge_torchrl.search.exploration import Explorer
from ge_torchrl.search.fitness import TrainingEpisodes
from ge_torchrl.search.hall_of_fame import HallOfFame, open_hall_of_fame
from ge_torchrl.search.refinement import RefinesTrees
from ge_torchrl.seeding import stream

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
    """
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
    if not is_compiled_before():
        console.print("Compiling the kernels for this machine, once; this takes some seconds ...")
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
            config.evaluation.std_penalty,
        )
        evolution.warm_up()
        hall = open_hall_of_fame(config, route)
        evolved = _evolve(planned, evolution, hall, folder, console)
        if evolved.stopped_by == "interrupt":
            console.print("Testing what was found; Ctrl-C again leaves it untested in the run folder.")
        summary, champion, best_by_size = conclude(config, evolution, evolved, hall, folder, started)
    finally:
        route.close()
    console.print()
    shown = folder.path.relative_to(Path.cwd()) if folder.path.is_relative_to(Path.cwd()) else folder.path
    told = closing_text(summary, champion.pruned, planned.spec.labels, shown, best_by_size)
    console.print(told, soft_wrap=True)
    return summary


def _evolve(
    planned: Plan, evolution: Evolution, hall: HallOfFame | None, folder: RunFolder, console: Console
) -> Evolved:
    """Run the loop over generations with its files and its progress; a fault keeps the best tree so far."""
    config = planned.config
    with ExitStack() as open_files:
        history = open_files.enter_context(folder.history_writer())
        progress = open_files.enter_context(Progress(console, config.ge.generations, config=config))
        loop = GenerationLoop(config, evolution, _each(history.write, progress.show), hall)
        if config.refiner.enabled:
            refinements = open_files.enter_context(folder.refinements_writer())
            refiner = _make_refiner(config, evolution.route)
            loop.refine_with(refiner, _each(refinements.write, progress.show_refinement))
            if hall is not None:
                snaps = config.refiner.write_back
                explorer = Explorer(config.hall_of_fame, evolution, hall, refiner, config.seed, snaps=snaps)
                loop.explore_with(explorer, lambda: _tell_of_last_refinement(config, console))
        try:
            return loop.run()
        except EnvironmentFaultError as fault:
            if loop.evolved is None:
                raise
            save_untested(config, evolution, loop.evolved, folder)
            raise EnvironmentFaultError(
                f"{fault}; the best tree so far is in {folder.path}, untested"
            ) from fault


def _tell_of_last_refinement(config: Config, console: Console) -> None:
    if config.hall_of_fame.final_keep > 0:
        console.print("Refining the best trees of each size once more ...")


def _each(*receivers: Callable[[_Record], None]) -> Callable[[_Record], None]:
    def receive(record: _Record) -> None:
        for receiver in receivers:
            receiver(record)

    return receive


def _make_refiner(config: Config, route: Route) -> RefinesTrees:
    # torch takes two seconds to import, which grammatical evolution alone need not pay.
    if config.refiner.method == "cmaes":
        from ge_torchrl.search.cmaes import CMAESRefiner

        return CMAESRefiner(route, config.refiner.cmaes)
    from ge_torchrl.search.ppo_refiner import PPORefiner

    return PPORefiner(route, config.refiner.ppo)
