"""The loop over generations: refine on schedule, record each generation, stop when there is a reason to."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ge_torchrl.applications import Applied, apply
from ge_torchrl.config import Config
from ge_torchrl.leader import LeaderObserver
from ge_torchrl.records import GenerationRecord, RefinementRecord
from ge_torchrl.search.champion import Contender
from ge_torchrl.search.evolution import Evolution, Generation
from ge_torchrl.search.exploration import Explorer
from ge_torchrl.search.hall_of_fame import HallOfFame
from ge_torchrl.search.refinement import RefinesTrees


@dataclass(frozen=True, eq=False)
class Evolved:
    """How far evolution has come.

    Attributes:
        last: The last generation.
        stopped_by: As in `Summary`.
        env_steps: Environment steps of all generations and refinements.
        born: Individuals ever made.
        invalid: Those of them without a tree.
        refined: The refined trees that were better than before, in the order of their generations.
        refinements: Refinements applied.
        refine_seconds: Clock time of the refinements.
        explored: Trees refined in exploring from the hall of fame.
        explore_seconds: Clock time of exploring.
        hall_env_steps: Environment steps of the hall of fame that `env_steps` includes: all where evolution profits
            from it, else none.
        validation_env_steps: Environment steps of asking validation whether the task is solved, which `env_steps`
            does not include.
        seconds: Clock time of everything.
    """

    last: Generation
    stopped_by: str
    env_steps: int
    born: int
    invalid: int
    refined: tuple[Contender, ...]
    refinements: int
    refine_seconds: float
    explored: int
    explore_seconds: float
    hall_env_steps: int
    validation_env_steps: int
    seconds: float

    @property
    def best_refined(self) -> float | None:
        """The best measured return of a refined tree so far."""
        return max((contender.fitness for contender in self.refined), default=None)


@dataclass(eq=False)
class GenerationLoop:
    """Runs generation after generation.

    Attributes:
        config: The run's configuration.
        evolution: Makes the generations.
        on_generation: Called with each generation's record.
        hall_of_fame: Is offered the leaders of each generation and every improved tree; or None.
    """

    config: Config
    evolution: Evolution
    on_generation: Callable[[GenerationRecord], None]
    hall_of_fame: HallOfFame | None = None
    _refiner: RefinesTrees | None = field(default=None, init=False)
    _explorer: Explorer | None = field(default=None, init=False)
    _before_finish: Callable[[], None] = field(default=lambda: None, init=False)
    _on_refinement: Callable[[RefinementRecord], None] = field(default=lambda _: None, init=False)
    _evolved: Evolved | None = field(default=None, init=False)
    _n_offered: int = field(default=0, init=False)
    _times_refined: Counter[bytes] = field(default_factory=Counter, init=False)
    _started: float = field(default=0.0, init=False)

    @property
    def evolved(self) -> Evolved | None:
        """How far evolution has come; None before the first generation."""
        return self._evolved

    def refine_with(self, refiner: RefinesTrees, on_refinement: Callable[[RefinementRecord], None]) -> None:
        """Refine a tree in the scheduled generations, and call `on_refinement` with each record."""
        self._refiner, self._on_refinement = refiner, on_refinement

    def explore_with(self, explorer: Explorer, before_finish: Callable[[], None] = lambda: None) -> None:
        """Explore from the hall of fame on schedule; call `before_finish` before the last refinement."""
        self._explorer, self._before_finish = explorer, before_finish

    def run(self) -> Evolved:
        """Run until something stops it; Ctrl-C keeps what was found so far.

        Raises:
            KeyboardInterrupt: It came before the first generation was there.
        """
        self._started = time.perf_counter()
        observer = LeaderObserver(self.config, self.evolution)
        try:
            generation = self.evolution.first()
            while True:
                self._evolved = self._with(generation)
                interrupted = self._refine(generation)
                self._offer(self._evolved.last)
                interrupted = interrupted or self._explore(self._evolved.last)
                evolved = self._counted(self._evolved)
                observer.observe(evolved.last, evolved.refined)
                evolved = replace(evolved, validation_env_steps=observer.env_steps)
                self.on_generation(_record(evolved, observer.decision_nodes))
                self._evolved = evolved
                reason = (
                    "interrupt"
                    if interrupted
                    else _reason_to_stop(self.config, evolved, solved=observer.solved)
                )
                if reason is not None:
                    return self._finish(replace(evolved, stopped_by=reason))
                # Not the generation as it was selected: refined trees may have been written back into it.
                generation = self.evolution.after(evolved.last)
        except KeyboardInterrupt:
            if self._evolved is None:
                raise
            return self._evolved

    def _with(self, generation: Generation) -> Evolved:
        before = self._evolved
        return Evolved(
            last=generation,
            stopped_by="interrupt",
            env_steps=generation.env_steps + (before.env_steps if before else 0),
            born=generation.n_born + (before.born if before else 0),
            invalid=generation.n_invalid + (before.invalid if before else 0),
            refined=before.refined if before else (),
            refinements=before.refinements if before else 0,
            refine_seconds=before.refine_seconds if before else 0.0,
            explored=before.explored if before else 0,
            explore_seconds=before.explore_seconds if before else 0.0,
            hall_env_steps=before.hall_env_steps if before else 0,
            validation_env_steps=before.validation_env_steps if before else 0,
            seconds=time.perf_counter() - self._started,
        )

    def _offer(self, generation: Generation) -> None:
        """Offer the hall of fame what this generation brought."""
        if self.hall_of_fame is None or self._evolved is None:
            return
        self.hall_of_fame.offer_leaders(generation, self.evolution.map)
        self.hall_of_fame.offer(self._evolved.refined[self._n_offered :])
        self._n_offered = len(self._evolved.refined)

    def _refine(self, generation: Generation) -> bool:
        """Refine a tree if this generation is due; tell whether Ctrl-C broke it off."""
        if self._refiner is None or not self.config.refiner.schedule.applies_to(generation.index):
            return False
        try:
            applications = apply(
                self._refiner, self.config, self.evolution, generation, self._best(), self._times_refined
            )
            for applied in applications:
                self._evolved = self._evolved_by(applied)
                self._on_refinement(applied.record)
        except KeyboardInterrupt:
            return True
        return False

    def _explore(self, generation: Generation) -> bool:
        """Explore if this generation is due; tell whether Ctrl-C broke it off."""
        if self._explorer is None or not self.config.refiner.schedule.applies_to(generation.index):
            return False
        started = time.perf_counter()
        try:
            explored = self._explorer.explore(generation)
        except KeyboardInterrupt:
            return True
        before = self._so_far()
        self._evolved = replace(
            before,
            last=explored.generation,
            explored=before.explored + explored.refined,
            explore_seconds=before.explore_seconds + time.perf_counter() - started,
            env_steps=before.env_steps + explored.env_steps,
        )
        return False

    def _finish(self, evolved: Evolved) -> Evolved:
        """Refine the kept trees once more, unless somebody waits; Ctrl-C leaves it."""
        self._evolved = evolved
        if self._explorer is None or evolved.stopped_by == "interrupt":
            return evolved
        self._before_finish()
        started = time.perf_counter()
        env_steps = self._explorer.finish(evolved.last.seeds)
        return self._counted(
            replace(
                evolved,
                env_steps=evolved.env_steps + env_steps,
                explore_seconds=evolved.explore_seconds + time.perf_counter() - started,
            )
        )

    def _counted(self, evolved: Evolved) -> Evolved:
        """Bring the clock up to date, and the steps of the hall of fame where evolution profits from it."""
        hall_env_steps = 0
        if self._explorer is not None and self.hall_of_fame is not None:
            hall_env_steps = self.hall_of_fame.env_steps
        return replace(
            evolved,
            env_steps=evolved.env_steps + hall_env_steps - evolved.hall_env_steps,
            hall_env_steps=hall_env_steps,
            seconds=time.perf_counter() - self._started,
        )

    def _best(self) -> float:
        evolved = self._so_far()
        return max(float(evolved.last.fitness.max()), evolved.best_refined or -np.inf)

    def _evolved_by(self, applied: Applied) -> Evolved:
        before = self._so_far()
        return replace(
            before,
            last=applied.generation,
            refined=before.refined + applied.refined,
            refinements=before.refinements + applied.refinements,
            refine_seconds=before.refine_seconds + applied.seconds,
            env_steps=before.env_steps + applied.env_steps,
        )

    def _so_far(self) -> Evolved:
        if self._evolved is None:
            raise ValueError("a refinement follows the selection of a generation")
        return self._evolved


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


def _record(evolved: Evolved, best_decision_nodes: int | None) -> GenerationRecord:
    generation = evolved.last
    valid = generation.fitness[np.isfinite(generation.fitness)]
    return GenerationRecord(
        generation=generation.index,
        best_fitness=float(valid.max()) if len(valid) else None,
        best_refined=evolved.best_refined,
        median_fitness=float(np.median(valid)) if len(valid) else None,
        mean_fitness=float(valid.mean()) if len(valid) else None,
        best_decision_nodes=best_decision_nodes,
        born=generation.n_born,
        invalid=generation.n_invalid,
        explored=evolved.explored,
        env_steps=evolved.env_steps,
        elapsed_seconds=evolved.seconds,
        evaluation_seconds=generation.evaluation_seconds,
        variation_seconds=generation.variation_seconds,
    )
