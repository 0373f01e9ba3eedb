"""A run from configuration to verdict: describe, evolve, choose, prune, test, write, tell."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from ge_torchrl import __version__
from ge_torchrl.artefacts import GenerationRecord, HistoryWriter, RunFolder, Summary
from ge_torchrl.compilation import is_compiled_before
from ge_torchrl.config import Config
from ge_torchrl.environments.choose import open_route
from ge_torchrl.environments.spec import EnvironmentSpec, describe
from ge_torchrl.errors import GrammarError
from ge_torchrl.ge.codons import Codons
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.rule_tables import RuleTables, compile_rules
from ge_torchrl.report.closing import closing_text, tree_text
from ge_torchrl.report.progress import Progress
from ge_torchrl.search.champion import Champion, choose_champion
from ge_torchrl.search.evolution import Evolution, Generation
from ge_torchrl.search.fitness import TrainingEpisodes, measure
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.complexity import complexity
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.serialization import TreeDocument
from ge_torchrl.trees.simplify import simplify_exact


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
        with folder.history_writer() as history, Progress(console, config.ge.generations) as progress:
            evolved = _evolve(evolution, planned, history, progress)
        summary, champion = _conclude(planned, evolution, evolved, folder, started)
    finally:
        route.close()
    console.print()
    shown = folder.path.relative_to(Path.cwd()) if folder.path.is_relative_to(Path.cwd()) else folder.path
    console.print(closing_text(summary, champion.pruned, planned.spec.labels, shown), soft_wrap=True)
    return summary


@dataclass(frozen=True, eq=False)
class Evolved:
    """How evolution ended.

    Attributes:
        last: The last generation.
        stopped_by: As in `Summary`.
        env_steps: Environment steps of all generations.
        born: Individuals ever made.
        invalid: Those of them without a tree.
        seconds: Clock time.
    """

    last: Generation
    stopped_by: str
    env_steps: int
    born: int
    invalid: int
    seconds: float


def _evolve(evolution: Evolution, planned: Plan, history: HistoryWriter, progress: Progress) -> Evolved:
    """Run generation after generation until something stops it; Ctrl-C keeps what was found so far."""
    started = time.perf_counter()
    observer = _BestObserver(evolution, planned)
    evolved: Evolved | None = None
    try:
        for generation in evolution.generations():
            evolved = Evolved(
                last=generation,
                stopped_by="interrupt",
                env_steps=generation.env_steps + (evolved.env_steps if evolved else 0),
                born=generation.n_born + (evolved.born if evolved else 0),
                invalid=generation.n_invalid + (evolved.invalid if evolved else 0),
                seconds=time.perf_counter() - started,
            )
            observer.observe(generation)
            record = _record(evolved, observer.decision_nodes)
            history.write(record)
            progress.show(record)
            if stopped_by := _reason_to_stop(planned.config, evolved, solved=observer.solved):
                return replace(evolved, stopped_by=stopped_by)
    except KeyboardInterrupt:
        if evolved is None:
            raise
    if evolved is None:
        raise ValueError("evolution yields at least its first generation")
    return evolved


def _reason_to_stop(config: Config, evolved: Evolved, *, solved: bool) -> str | None:
    ge = config.ge
    if evolved.last.index + 1 >= ge.generations:
        return "generations"
    if ge.stop_when_solved and solved:
        return "solved"
    if ge.max_seconds is not None and evolved.seconds >= ge.max_seconds:
        return "max_seconds"
    if ge.max_env_steps is not None and evolved.env_steps >= ge.max_env_steps:
        return "max_env_steps"
    return None


class _BestObserver:
    """Looks at the fittest tree of each generation, and only when it is another one than before."""

    def __init__(self, evolution: Evolution, planned: Plan) -> None:
        self.decision_nodes: int | None = None
        self.solved = False
        self._evolution = evolution
        self._spec = planned.spec
        self._codons: Codons | None = None
        self._validation_seeds = (
            _validation_seeds(planned.config) if planned.config.ge.stop_when_solved else None
        )

    def observe(self, generation: Generation) -> None:
        """Note the size of the fittest tree, and whether it solves the task on the validation episodes."""
        codons = generation.codons[generation.best]
        if self._codons is not None and np.array_equal(codons, self._codons):
            return
        self._codons = codons
        mapping = self._evolution.map(codons[np.newaxis])
        if not mapping.valid[0]:
            return
        tree = simplify_exact(mapping.forest.tree(0), self._spec.low, self._spec.high)
        self.decision_nodes = tree.n_decision_nodes
        if self._validation_seeds is not None and self._spec.is_solved(generation.fitness[generation.best]):
            # Few training episodes say "solved" too easily: the validation episodes have to agree.
            validated = measure(self._evolution.route, Forest.stack([tree]), self._validation_seeds)
            self.solved = self._spec.is_solved(float(validated.fitness[0]))


def _validation_seeds(config: Config) -> NDArray[np.int64]:
    rng = stream(config.seed, "validation episodes")
    return episode_seeds("validation", config.evaluation.validation_episodes, rng)


def _record(evolved: Evolved, best_decision_nodes: int | None) -> GenerationRecord:
    generation = evolved.last
    valid = generation.fitness[np.isfinite(generation.fitness)]
    return GenerationRecord(
        generation=generation.index,
        best_fitness=float(valid.max()) if len(valid) else None,
        median_fitness=float(np.median(valid)) if len(valid) else None,
        mean_fitness=float(valid.mean()) if len(valid) else None,
        best_decision_nodes=best_decision_nodes,
        born=generation.n_born,
        invalid=generation.n_invalid,
        env_steps=evolved.env_steps,
        elapsed_seconds=evolved.seconds,
        evaluation_seconds=generation.evaluation_seconds,
        variation_seconds=generation.variation_seconds,
    )


def _conclude(
    planned: Plan, evolution: Evolution, evolved: Evolved, folder: RunFolder, started: float
) -> tuple[Summary, Champion]:
    """Choose the champion, prune it, test it on unseen episodes and write what was found."""
    config, spec, route = planned.config, planned.spec, evolution.route
    mapping = evolution.map(evolved.last.codons)
    if not mapping.valid.any():
        raise GrammarError(
            f"no genotype of {config.ge.genotype_length} codons gave a tree in {evolved.born} tries; "
            f"the grammar {config.grammar.name} needs a longer one (ge.genotype_length) or wraps (ge.wraps)"
        )
    champion = choose_champion(
        route,
        mapping,
        evolved.last.fitness,
        config.evaluation.champion_candidates,
        _validation_seeds(config),
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
        evolve_seconds=evolved.seconds,
        wall_seconds=time.perf_counter() - started,
        invalid_fraction=evolved.invalid / evolved.born,
        route=route.name,
        solved_at=spec.solved_at,
        version=__version__,
    )
    _write(planned, champion, folder, summary)
    return summary, champion


def _write(planned: Plan, champion: Champion, folder: RunFolder, summary: Summary) -> None:
    labels = planned.spec.labels
    origin = {
        "program": f"ge_torchrl {__version__}",
        "seed": summary.seed,
        "grammar": planned.config.grammar.name,
        "train_fitness": summary.train_fitness,
        "validation_mean": summary.validation_mean,
    }
    folder.write_trees(
        TreeDocument(champion.pruned, labels, {**origin, "pruned": True, "test_mean": summary.test_mean}),
        TreeDocument(champion.full, labels, {**origin, "pruned": False, "test_mean": summary.test_mean_full}),
        tree_text(champion.pruned, labels),
    )
    folder.write_summary(summary)
