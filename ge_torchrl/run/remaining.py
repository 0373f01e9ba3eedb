"""How fast a run goes on, and how much longer it takes."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter, deque
from collections.abc import Collection
from dataclasses import dataclass
from statistics import median

from ge_torchrl.artefacts.records import GenerationRecord
from ge_torchrl.config import Config
from ge_torchrl.run.allowance import Phase
from ge_torchrl.run.costs import NOTHING, Cost
from ge_torchrl.search.archive import ARCHIVE
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.refinement import snaps
from ge_torchrl.search.state import SearchState

# Of the budget of PPO's last refinement so much is spent, since trees that were refined before converge early.
_SPENT = 0.28
# Constants of a tree settle in so many trials about, each of all its episodes.
_SETTLING = 105
# Where kept trees were measured for less, that says nothing of their speed [s].
_SHORTEST = 0.02
# Of the steps of a run with dear steps so much goes into rounding.
_ROUNDING = 0.05
# A refinement takes this part of the first one.
_FIRST_REFINEMENT = 0.7
# Generations of a kind that tell of those to come: the longer trees live, the longer they take.
_LATEST = 4


@dataclass(frozen=True)
class Pace:
    """How fast a search goes on, what came before its first generation left out: compiling, importing, measuring.

    Attributes:
        seconds_per_generation: Mean clock time of a generation.
        steps_per_second: Environment steps a second.
    """

    seconds_per_generation: float
    steps_per_second: float

    @classmethod
    def between(cls, first: GenerationRecord, last: GenerationRecord) -> Pace:
        """Return the pace from the end of one generation to the end of another.

        Args:
            first: A generation of the run; with no other yet it tells by its own clock.
            last: The last one.
        """
        generations = last.generation - first.generation
        if generations == 0:
            seconds = last.evaluation_seconds + last.variation_seconds
            return cls(seconds / (last.generation + 1), last.env_steps / max(seconds, 1e-9))
        seconds = last.elapsed_seconds - first.elapsed_seconds
        return cls(seconds / generations, (last.env_steps - first.env_steps) / max(seconds, 1e-9))


class Estimate:
    """How much longer a run takes, its limits held, as far as one can tell from the generations so far.

    Generations with a refinement count by themselves: where steps are dear they take far longer than others. Before the
    first of them a guess stands in for it.

    Args:
        config: The configuration, its budgets resolved.
        search_share: The part of the run's limits at which the search has to end.
        refinement: Guess of what a generation's refinement takes.
    """

    def __init__(self, config: Config, search_share: float = 1.0, refinement: Cost = NOTHING) -> None:
        self._config, self._share, self._refinement = config, search_share, refinement
        self._due = [g for g in range(config.ge.generations) if self._is_refined(g)]
        self._last: GenerationRecord | None = None
        self._first = NOTHING
        self._plain: deque[Cost] = deque(maxlen=_LATEST)
        self._refined: deque[Cost] = deque(maxlen=_LATEST)

    def seconds_left(self, record: GenerationRecord, after_search: float = 0.0) -> float:
        """Take notice of one more generation, and return the seconds left after it.

        Args:
            record: The generation.
            after_search: Seconds that what follows the search is expected to take; see `after_search`.
        """
        self._notice(record)
        plain = _typical(self._plain) if self._plain else self._first
        refined = _typical(self._refined) if self._refined else plain + self._refinement
        ge, elapsed = self._config.ge, record.elapsed_seconds
        n_refined = len(self._due) - bisect_right(self._due, record.generation)
        n_plain = ge.generations - record.generation - 1 - n_refined
        search = plain.times(n_plain) + refined.times(n_refined)
        if ge.max_env_steps and search.steps > 0:
            most = self._share * ge.max_env_steps - record.env_steps
            search = search.times(max(0.0, min(1.0, most / search.steps)))
        seconds = search.seconds
        if ge.max_seconds is not None:
            seconds = min(seconds, max(0.0, self._share * ge.max_seconds - elapsed))
        return self.within(seconds + after_search, elapsed)

    def within(self, seconds: float, elapsed: float) -> float:
        """Return as many seconds as the limit of the run leaves of those that are needed.

        Args:
            seconds: That are needed.
            elapsed: Of the run so far.
        """
        limit = self._config.ge.max_seconds
        return seconds if limit is None else max(0.0, min(seconds, limit - elapsed))

    def _notice(self, record: GenerationRecord) -> None:
        last, self._last = self._last, record
        if last is None:
            # What came before it is left out: compiling, importing, measuring.
            self._first = Cost(record.evaluation_seconds + record.variation_seconds, record.env_steps)
        elif record.generation > last.generation:
            took = Cost(
                record.elapsed_seconds - last.elapsed_seconds, record.env_steps - last.env_steps
            ).times(1 / (record.generation - last.generation))
            if self._is_refined(record.generation):
                # The first one loads PyTorch, and compiles.
                self._refined.append(took if self._refined else took.times(_FIRST_REFINEMENT))
            else:
                self._plain.append(took)

    def _is_refined(self, generation: int) -> bool:
        refiner = self._config.refiner
        return refiner.enabled and refiner.schedule.applies_to(generation)


def after_search(
    problem: Problem, state: SearchState, refine_seconds: float, concluded: Collection[str] = ()
) -> float:
    """Return the seconds that the last refinement, rounding, validation and test are expected to take.

    Args:
        problem: What is searched.
        state: Its last state.
        refine_seconds: What the refiner has taken so far.
        concluded: Which of these phases are over.
    """
    config, backend, settings = problem.config, problem.backend, problem.config.archive
    nodes = Counter(member.tree.num_decision_nodes for member in state.archive.members)
    length, speed = _kept_length(problem, state), _kept_speed(problem)
    small = config.evaluation.steps_per_second or backend.steps_per_second
    n_refined = sum(min(kept, settings.final_keep) for size, kept in nodes.items() if size > 0)
    n_refined *= Phase.FINAL_REFINEMENT.value not in concluded
    efforts = n_refined * settings.final_factor * settings.final_patience
    seconds = 0.0
    if problem.polisher is not None or config.refiner.method == "cmaes":
        # Its whole budget is spent: a patient search starts again where it has converged.
        settling = _SETTLING * n_refined * config.polish.settling_episodes * length if snaps(problem) else 0.0
        # Measured are visits too, which some kernels count slowly.
        seconds += (efforts * config.polish.max_timesteps + settling) / max(speed, small)
    elif problem.refines:
        seconds += efforts * refine_seconds / max(1, state.counts.refined) * _SPENT
    if problem.rounds and config.ge.max_env_steps and Phase.ROUNDING.value not in concluded:
        seconds += _ROUNDING * config.ge.max_env_steps / speed
    evaluation, n_kept = config.evaluation, nodes.total()
    episodes = (n_kept + 2) * evaluation.validation_episodes + (len(nodes) + 2) * evaluation.test_episodes
    return seconds + episodes * length / speed


def _kept_speed(problem: Problem) -> float:
    """Return how many steps a second kept trees make, as far as those that were offered tell."""
    steps, seconds = problem.backend.ledger.timed.get(ARCHIVE, (0, 0.0))
    if seconds >= _SHORTEST:
        return steps / seconds
    return problem.config.evaluation.steps_per_second or problem.backend.steps_per_second


def _kept_length(problem: Problem, state: SearchState) -> float:
    """Return how many steps an episode of a kept tree has, about: those that were offered are measured alike."""
    longest = problem.backend.spec.max_episode_steps
    measured = len(state.archive.offered) * problem.config.archive.episodes
    # Most trees are offered under two digests, as they came and pruned.
    steps = 2 * problem.backend.steps[ARCHIVE] / measured if measured else longest
    return min(longest, steps)


def _typical(costs: Collection[Cost]) -> Cost:
    return Cost(median(cost.seconds for cost in costs), median(cost.steps for cost in costs))


def duration(seconds: float | None) -> str:
    """Return seconds as minutes and seconds, with hours where there are any; a dash where nobody knows."""
    if seconds is None:
        return "-"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def rate(per_second: float) -> str:
    """Return how many a second, in thousands or millions where it is as many: `30.6 k`."""
    for unit, size in (("M", 1e6), ("k", 1e3)):
        if per_second >= size:
            return f"{per_second / size:.1f} {unit}"
    return f"{per_second:.0f}"
