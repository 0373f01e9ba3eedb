"""One run from its plan to its verdict: search, conclude, and leave everything where it belongs."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress

from rich.console import Console

from ge_torchrl.artefacts.checkpoints import Checkpoint
from ge_torchrl.artefacts.memory import Artefacts, Records
from ge_torchrl.artefacts.records import Summary
from ge_torchrl.config import Config
from ge_torchrl.environments.backend import Backend, LimitReachedError
from ge_torchrl.errors import ArtefactError, GrammarError, UserError
from ge_torchrl.interrupts import ignore_interrupts, last_words
from ge_torchrl.report.methods import method_of, refiner_of
from ge_torchrl.run.allowance import Allowance, Phase
from ge_torchrl.run.broken_off import save_trees, save_what_there_is, told_of_fault
from ge_torchrl.run.checkpointing import Checkpointing
from ge_torchrl.run.costs import refinement_cost
from ge_torchrl.run.episodes import keep_episodes
from ge_torchrl.run.finished import Finished, JudgingSeeds, Observer
from ge_torchrl.run.loop import Search
from ge_torchrl.run.plan import Plan
from ge_torchrl.run.progress import Progress, print_line
from ge_torchrl.run.recording import (
    best_by_nodes,
    generation_record,
    refinement_records,
    summary_of,
    write_verdict,
)
from ge_torchrl.run.refinement_lines import bettered
from ge_torchrl.run.refining import refiners_of, with_batches
from ge_torchrl.run.remaining import after_search
from ge_torchrl.run.telling import opening_line, warnings_told
from ge_torchrl.run.tracking import tracking
from ge_torchrl.search.conclusion import Verdict, choose, contenders_of, examine, refine_once_more
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.refinement import IMPROVED
from ge_torchrl.search.restarts import together
from ge_torchrl.search.rounding import round_kept
from ge_torchrl.search.state import Events, SearchState
from ge_torchrl.trees.controller import Controller

_logger = logging.getLogger(__name__)

_TESTING = "Testing what was found; Ctrl-C again leaves it untested."
INTERRUPT = "interrupt"
_REFINED = (Phase.FINAL_REFINEMENT.value, Phase.ROUNDING.value)


class Run:
    """One run: its search, its artefacts and its screen."""

    def __init__(
        self,
        planned: Plan,
        backend: Backend,
        keep: Callable[[Config], Artefacts],
        console: Console,
        observer: Observer,
        started: float,
        judging_seeds: JudgingSeeds,
    ) -> None:
        given = planned.config.evaluation.steps_per_second
        speed, sums = backend.steps_per_second if given is None else given, planned.tables.grammar.has_sums
        self.config = with_batches(planned.config.resolved(speed, has_sums=sums), backend)
        self.names, self.notes, self.looked = planned.spec.names, planned.notes, planned.seconds
        self.console, self.observer, self.started = console, observer, started
        self.folder, self.backend = keep(self.config), backend
        both = refiners_of(self.config, backend)
        self.problem = Problem(self.config, planned.tables, backend, *both, planned.mirror, judging_seeds)
        self.search = Search(self.problem, self._watch)
        self.checkpoints = Checkpointing(self.folder, self._save_trees)
        self.warnings: list[str] = []
        self.refine_seconds = self.polish_seconds = 0.0
        self.improved, self.once_more = 0, ""
        self.stopped_by: str | None = None
        self.concluded: tuple[str, ...] = ()
        self.is_interrupted = False
        checkpoint = self.folder.begin(self.names, lambda line: print_line(console, line))
        if checkpoint is not None:
            self._go_on_from(checkpoint)
        self.allowance = Allowance.of(
            self.config, self.started, backend.spec.max_episode_steps, rounds=self.problem.rounds
        )

    def _go_on_from(self, checkpoint: Checkpoint) -> None:
        self.search.state, self.search.asked = checkpoint.state, checkpoint.asked
        self.backend.steps.clear()
        self.backend.steps.update(checkpoint.steps)
        if self.backend.witness is not None:
            self.backend.witness.recall(checkpoint.outside, is_endless=checkpoint.is_endless)
        self.warnings += checkpoint.warnings
        self.stopped_by, self.concluded = checkpoint.stopped_by, checkpoint.concluded
        self.improved, self.started = checkpoint.improved, self.started - checkpoint.seconds
        self.refine_seconds, self.polish_seconds = checkpoint.refine_seconds, checkpoint.polish_seconds

    def _note_checkpoint(self) -> None:
        if self.search.state is None:
            raise ValueError("a checkpoint stands after a generation")
        witness = self.backend.witness
        checkpoint = Checkpoint(
            state=self.search.state,
            steps=dict(self.backend.steps),
            asked=self.search.asked,
            outside={} if witness is None else dict(witness.outside),
            is_endless=witness is not None and witness.is_endless,
            warnings=tuple(self.warnings),
            stopped_by=self.stopped_by,
            concluded=self.concluded,
            improved=self.improved,
            seconds=time.perf_counter() - self.started,
            refine_seconds=self.refine_seconds,
            polish_seconds=self.polish_seconds,
            lines=self.folder.lines,
        )
        self.checkpoints.note(checkpoint)

    def to_the_end(self) -> Finished:
        """Search and conclude; whatever ends it before, what there is is kept."""
        config, console = self.config, self.console
        print_line(console, opening_line(config, self.backend))
        with ExitStack() as opened:
            opened.enter_context(warnings_told(self.warnings, console))
            for note in self.notes:
                _logger.warning("%s", note)
            self.history: Records = opened.enter_context(self.folder.history_writer())
            if self.problem.refiner is not None:
                self.refinements: Records = opened.enter_context(self.folder.refinements_writer())
            name = f"{self.backend.spec.id} {method_of(config)} seed {config.seed}"
            self.tracker = opened.enter_context(tracking(config, self.folder.path, name))
            self.progress = opened.enter_context(self._progress())
            if self.search.state is not None:
                self.progress.recall(self.folder.read_history(), self._seconds_after(self.search.state))
                self.progress.say(f"Going on after generation {self.search.state.generation} ...")
            self.backend.on_steps = self.progress.beat
            opened.enter_context(last_words(self._save_what_there_is))
            try:
                stopped_by, evolve_seconds, verdict = self._search_and_choose()
            except LimitReachedError as limit:
                small = UserError(self.allowance.too_small(limit.reason, self.looked))
                found = self._save_what_there_is(may_go_on=False)
                raise told_of_fault(small, found, self.folder) from limit
            except KeyboardInterrupt:
                ignore_interrupts()
                saved = self._save_what_there_is()
                self.progress.end()
                print_line(console, f"interrupted; {saved}")
                raise KeyboardInterrupt(saved) from None
            except Exception as fault:
                if isinstance(fault, BrokenPipeError) and console.quiet:
                    self._save_what_there_is()
                    raise  # Nobody reads the screen any more; nothing broke.
                raise told_of_fault(fault, self._save_what_there_is(), self.folder) from fault
            records = write_verdict(config, self.names, self.folder, verdict)
            self.backend.limit = self.allowance.until(Phase.RECORD)
            keep_episodes(self.folder, self.problem, verdict)
            summary = self._summary(verdict, stopped_by, evolve_seconds)
            self.tracker.verdict(summary)
        self.folder.write_summary(summary)
        if not self.is_interrupted:
            self.folder.finish()
        champion = Controller(verdict.champion.pruned, self.names)
        refiner = refiner_of(method_of(config))
        return Finished(self.folder, summary, champion, records, refiner, self.improved, self.once_more)

    def _progress(self) -> Progress:
        config = self.config
        return Progress(
            self.console,
            config.ge.generations,
            config,
            self.allowance.ends[Phase.SEARCH],
            refinement_cost(config, self.backend.spec.max_episode_steps),
            compiles=self.backend.name == "kernel",
        )

    def _search_and_choose(self) -> tuple[str, float, Verdict]:
        self.backend.limit = self.allowance.until(Phase.SEARCH)
        stopped_by = self.stopped_by or self.search.run()
        self.is_interrupted = stopped_by == INTERRUPT
        if not self.is_interrupted:
            self.stopped_by = stopped_by
            self._note_checkpoint()
        self.checkpoints.write()
        state = self._last_state()
        if stopped_by in ("max_seconds", "max_env_steps"):
            self._tell_of_limit(state, stopped_by)
        contenders = contenders_of(self.problem, state)
        if not contenders:
            raise GrammarError(
                f"no genotype of {self.config.ge.genotype_length} codons gave a tree in {state.counts.born} tries; "
                f"the grammar {self.config.grammar.name} needs a longer one (ge.genotype_length) or wraps (ge.wraps)"
            )
        if self.is_interrupted:
            self.progress.say(_TESTING)
        else:
            state = self._finished(state)
        evolve_seconds = time.perf_counter() - self.started
        self._expect(state, _REFINED)
        self.progress.say("Validation and test ...")
        self.backend.limit = self.allowance.until(Phase.VALIDATION)
        champion, by_size = choose(self.problem, contenders_of(self.problem, state))
        self.backend.limit = self.allowance.until(Phase.TEST)
        return stopped_by, evolve_seconds, examine(self.problem, champion, by_size)

    def _finished(self, state: SearchState) -> SearchState:
        """Refine the kept trees once more and round them; Ctrl-C goes on with what was there."""
        try:
            if self.config.archive.final_keep > 0 and self.problem.refines:
                say = "Refining the best trees of each size once more ..."
                state = self._concluded(Phase.FINAL_REFINEMENT, say, refine_once_more, state)
            if self.problem.rounds:
                say = "Rounding the best trees to few terms and few digits ..."
                state = self._concluded(Phase.ROUNDING, say, round_kept, state)
        except KeyboardInterrupt:
            self.is_interrupted = True
            self.progress.say(_TESTING)
        return state

    def _concluded(
        self, phase: Phase, say: str, part: Callable[[Problem, SearchState], SearchState], state: SearchState
    ) -> SearchState:
        """Return the state after a part of the conclusion, which a checkpoint may have brought already."""
        if phase.value in self.concluded:
            return state
        self._expect(state)
        self.progress.say(say)
        self.backend.limit, before = self.allowance.until(phase), best_by_nodes(state.archive)
        self.search.state = state = part(self.problem, state)
        self.concluded += (phase.value,)
        if phase is Phase.FINAL_REFINEMENT:
            self.once_more = bettered(before, best_by_nodes(state.archive))
            self.progress.note(self.once_more)
        self._note_checkpoint()
        self.checkpoints.write()
        return state

    def _expect(self, state: SearchState, concluded: tuple[str, ...] = ()) -> None:
        self.progress.expect(self._seconds_after(state, concluded), time.perf_counter() - self.started)

    def _seconds_after(self, state: SearchState, concluded: tuple[str, ...] = ()) -> float:
        return after_search(self.problem, state, self.refine_seconds, concluded or self.concluded)

    def _tell_of_limit(self, state: SearchState, limit: str) -> None:
        self.progress.note(
            f"ge.{limit} is near: generation {state.generation + 1} was broken off, and nothing of it is kept"
        )
        if self.config.refiner.enabled and state.counts.refined == 0:
            _logger.warning("ge.%s left no room to refine trees.", limit)

    def _last_state(self) -> SearchState:
        if self.search.state is None:
            raise ValueError("a search that ended has a state")
        return together(self.problem, self.search.state)

    def _watch(self, state: SearchState, events: Events) -> bool:
        if events.begins_anew:
            self.progress.say(
                "Beginning anew with another population; the best trees so far are set aside ..."
            )
        self.refine_seconds += events.refine_seconds
        self.polish_seconds += events.polish_seconds
        for refinement in refinement_records(state, events):
            self.refinements.write(refinement)
            self.improved += refinement.outcome == IMPROVED
            self.progress.show_refinement(refinement)
        elapsed = time.perf_counter() - self.started
        record = generation_record(state, events, self.backend.steps.total(), elapsed)
        self.history.write(record)
        kept = best_by_nodes(state.archive)
        self.tracker.generation(record, kept)
        self.progress.show(record, kept, self._seconds_after(state))
        self._note_checkpoint()
        return self.observer(record, state, self.names)

    def _save_what_there_is(self, *, may_go_on: bool = True) -> str:
        """Save the best tree so far and the kept ones, and return what to say of them."""
        with suppress(ArtefactError):
            self.checkpoints.write()
        state = None if self.search.state is None else self._last_state()
        return save_what_there_is(self.problem, self.names, self.folder, state, may_go_on=may_go_on)

    def _save_trees(self) -> None:
        save_trees(self.problem, self.names, self.folder, self._last_state())

    def _summary(self, verdict: Verdict, stopped_by: str, evolve_seconds: float) -> Summary:
        spent = {
            "evolve_seconds": evolve_seconds,
            "refine_seconds": self.refine_seconds,
            "polish_seconds": self.polish_seconds,
            "wall_seconds": time.perf_counter() - self.started,
        }
        return summary_of(self.problem, self._last_state(), verdict, stopped_by, self.warnings, spent)
