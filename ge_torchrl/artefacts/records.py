"""The records that a run leaves: plain frozen values, one for each line or file of JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

CLOCK_FIELDS = frozenset(
    {
        "elapsed_seconds",
        "evaluation_seconds",
        "evolve_seconds",
        "polish_seconds",
        "refine_seconds",
        "sampling_workers",
        "steps_per_second",
        "variation_seconds",
        "wall_seconds",
        "workers",
    }
)
"""What the clock says differs from run to run; everything else follows from configuration and seed (law 6)."""


@dataclass(frozen=True)
class GenerationRecord:
    """One line of the history.

    Attributes:
        generation: 0 for the random first population.
        best_fitness: Of the whole population; None where no individual has a tree.
        best_refined: The best that a refined tree was measured with so far, on the scale of fitness; None before there
            is one.
        median_fitness: Of the individuals that have a tree.
        mean_fitness: Likewise.
        best_decision_nodes: Of the fittest tree, without splits that no state can reach.
        born: Individuals made in this generation.
        invalid: Those of them without a tree.
        env_steps: Environment steps since the start of the run.
        elapsed_seconds: Clock time since the start of the search.
        evaluation_seconds: Clock time of this generation's rollouts.
        variation_seconds: Clock time of its selection, variation and mapping.
        refined: Trees that the refiner has refined so far, individuals and proposals of the archive.
        polished: Trees that local search has polished so far.
    """

    generation: int
    best_fitness: float | None
    best_refined: float | None
    median_fitness: float | None
    mean_fitness: float | None
    best_decision_nodes: int | None
    born: int
    invalid: int
    env_steps: int
    elapsed_seconds: float
    evaluation_seconds: float
    variation_seconds: float
    refined: int = 0
    polished: int = 0

    @property
    def best(self) -> float | None:
        """The best fitness so far, refined trees included; None where there is no tree."""
        measured = (value for value in (self.best_fitness, self.best_refined) if value is not None)
        return max(measured, default=None)


@dataclass(frozen=True)
class RefinementRecord:
    """One tree that the refiner refined; numbers are None where they are unknown or were not finite.

    Returns are on the scale of fitness: less `evaluation.std_penalty` of their standard deviations, where it is set.

    Attributes:
        generation: After whose selection it happened.
        outcome: "improved" where the tree is better than before on the same unseen episodes, "not_improved",
            "failed" where training broke off, "skipped" where the population held no candidate.
        origin: "individual" of the population, "neighbour" of a tree in the archive, or "archive" for a tree of it.
        redraws: Rejected candidates, where an individual was drawn.
        chosen: How an individual was chosen: "best", "random", or "fittest" of its structure; None for another origin.
        individual: Its index in the population; None for another origin.
        decision_nodes: Of the tree before.
        fitness_before: Its fitness on the training episodes.
        return_before: Its mean return on the measuring episodes.
        soft_return: Mean return of the soft tree's episodes in the last update.
        return_after: Mean return of the refined tree on the measuring episodes.
        return_snapped: Mean return on them of the tree that the grammar's constants leave of it; None without
            write-back, or where no genotype holds the tree.
        written_back: Whether the snapped tree took its source's place in the population.
        new_best: Whether the refined tree exceeds the generation's best fitness, earlier refined trees included.
        parameters_moved: Numbers of the tree that changed.
        largest_parameter_move: The largest of these changes.
        leaves_changed: Leaves whose action changed.
        timesteps: Environment steps sampled.
        updates: Batches of samples trained on, or of trees measured.
        gradient_steps: Optimiser steps.
        actor_loss: Clipped surrogate at the last step.
        critic_loss: Value loss at the last step.
        entropy: Mean entropy of the actions at the last step, in nats.
        clip_fraction: Share of clipped ratios at the last step.
        kl: Estimate at the last step of the divergence from the policy that sampled.
        failure: What broke, or None.
        refine_seconds: Clock time; of trees that were refined side by side each has an equal share.
    """

    generation: int
    outcome: str
    origin: str = "individual"
    redraws: int = 0
    chosen: str | None = None
    individual: int | None = None
    decision_nodes: int | None = None
    fitness_before: float | None = None
    return_before: float | None = None
    soft_return: float | None = None
    return_after: float | None = None
    return_snapped: float | None = None
    written_back: bool = False
    new_best: bool = False
    parameters_moved: int | None = None
    largest_parameter_move: float | None = None
    leaves_changed: int | None = None
    timesteps: int | None = None
    updates: int | None = None
    gradient_steps: int | None = None
    actor_loss: float | None = None
    critic_loss: float | None = None
    entropy: float | None = None
    clip_fraction: float | None = None
    kl: float | None = None
    failure: str | None = None
    refine_seconds: float = 0.0


@dataclass(frozen=True)
class ArchiveRecord:
    """The best tree of one size; what no episodes have measured yet is None.

    Attributes:
        decision_nodes: Of the pruned tree.
        depth: Its depth.
        complexity_M: Its complexity by Eq. 4.
        archive_mean: Mean return on the archive's episodes, which kept it; None for a champion too large for it.
        validation_mean: Mean return on the validation episodes, which chose it among the trees of its size.
        test_mean: Mean return on the run's test episodes, which chose nothing.
        test_std: Standard deviation of these returns.
        origin: "population", "refinement", "polish" or "start": where the tree was last changed.
    """

    decision_nodes: int
    depth: int
    complexity_M: float  # noqa: N815 (the paper's symbol)
    archive_mean: float | None
    validation_mean: float | None
    test_mean: float | None
    test_std: float | None
    origin: str


@dataclass(frozen=True)
class Summary:
    """What a run found; all that a table needs of it.

    Attributes:
        environment: Gymnasium id.
        seed: Of the run.
        solved: Whether the test mean reaches the environment's threshold; None where it has none.
        train_fitness: The champion's fitness on its few training episodes, as the thesis reports it.
        validation_mean: Its mean return on the validation episodes that chose it.
        test_mean: Mean return of the pruned champion on unseen episodes.
        test_std: Standard deviation of these returns.
        test_episodes: Their number.
        test_mean_full: Mean return of the unpruned champion on the same episodes: what pruning cost.
        decision_nodes: Of the pruned champion.
        depth: Likewise.
        complexity_M: Likewise, by Eq. 4.
        generations: Generations run, the first population included.
        stopped_by: "generations", "solved", "callback", "max_seconds", "max_env_steps" or "interrupt".
        env_steps: Environment steps of the search: all but validation and test.
        steps: Environment steps by purpose.
        steps_per_second: What the budgets followed from.
        refinements: Individuals of the population that the refiner refined.
        refinements_improved: Those that became better on the same unseen episodes.
        refined: All trees that the refiner refined, proposals of the archive included.
        polished: Trees that local search polished.
        champion_from: "population", "refinement", "polish" or "start": where the champion was last changed.
        evolve_seconds: Clock time of the search, refinement and polish included.
        refine_seconds: Clock time of the refinements.
        polish_seconds: Clock time of the polish.
        wall_seconds: Clock time of the whole run.
        invalid_fraction: Share of all individuals ever made that have no tree.
        route: "kernel" or "gymnasium".
        solved_at: The threshold, or None.
        version: Of ge_torchrl.
        warnings: What the user was warned of, a line each.
        workers: Processes that ran trees, as `env.workers` counts them: what was asked for or, by the clock, paid; None
            where nobody wrote it down.
        sampling_workers: Likewise, processes that sampled the environment for PPO; None where none did, because kernels
            sample or nothing is trained.
        env_steps_total: The sum of `steps`.
    """

    environment: str
    seed: int
    solved: bool | None
    train_fitness: float
    validation_mean: float
    test_mean: float
    test_std: float
    test_episodes: int
    test_mean_full: float
    decision_nodes: int
    depth: int
    complexity_M: float  # noqa: N815 (the paper's symbol)
    generations: int
    stopped_by: str
    env_steps: int
    steps: Mapping[str, int]
    steps_per_second: float
    refinements: int
    refinements_improved: int
    refined: int
    polished: int
    champion_from: str
    evolve_seconds: float
    refine_seconds: float
    polish_seconds: float
    wall_seconds: float
    invalid_fraction: float
    route: str
    solved_at: float | None
    version: str
    warnings: tuple[str, ...] = ()
    workers: int | None = None
    sampling_workers: int | None = None
    env_steps_total: int = field(init=False)

    def __post_init__(self) -> None:
        # The ledger goes on counting, and a Counter does not survive asdict.
        object.__setattr__(self, "steps", dict(self.steps))
        # Written out for readers of the file, computed so that it cannot contradict the ledger.
        object.__setattr__(self, "env_steps_total", sum(self.steps.values()))
