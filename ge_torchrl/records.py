"""The records that a run leaves: plain frozen values, one for each line or file of JSON."""

from __future__ import annotations

import math
from dataclasses import dataclass

# What the clock says differs from run to run; everything else is a function of configuration and seed (law 6).
CLOCK_FIELDS = frozenset(
    {
        "evolve_seconds",
        "wall_seconds",
        "elapsed_seconds",
        "evaluation_seconds",
        "variation_seconds",
        "refine_seconds",
        "explore_seconds",
    }
)


@dataclass(frozen=True)
class GenerationRecord:
    """One line of the history.

    Attributes:
        generation: 0 for the random first population.
        best_fitness: Of the whole population; None where no individual has a tree.
        best_refined: The best return that a refined tree was measured with so far; None before there is one.
        median_fitness: Of the individuals that have a tree.
        mean_fitness: Likewise.
        best_decision_nodes: Size of the fittest tree, without splits that no state can reach.
        born: Individuals made in this generation.
        invalid: Those of them without a tree.
        env_steps: Environment steps since the start of the run.
        elapsed_seconds: Clock time since the start of evolution.
        evaluation_seconds: Clock time of this generation's rollouts.
        variation_seconds: Clock time of its selection, variation and mapping.
        explored: Trees refined so far in exploring from the hall of fame.
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
    explored: int = 0


@dataclass(frozen=True)
class TrainingRecord:
    """What a refinement took; losses and their companions are those of the last gradient step, NaN before the first.

    Attributes:
        timesteps: Environment steps taken.
        updates: Batches of samples trained on, or of trees measured.
        gradient_steps: Gradient steps taken.
        soft_return: Mean return of the episodes that ended in the last update with any; NaN if none ever ended.
        actor_loss: Clipped surrogate, to be minimised.
        critic_loss: Weighted squared error of the values.
        entropy: Mean entropy of the actions, in nats.
        clip_fraction: Share of samples whose ratio is clipped.
        kl: Estimate of the divergence of the policy from the one that sampled.
        failure: What was not finite, and when; None if nothing.
    """

    timesteps: int = 0
    updates: int = 0
    gradient_steps: int = 0
    soft_return: float = math.nan
    actor_loss: float = math.nan
    critic_loss: float = math.nan
    entropy: float = math.nan
    clip_fraction: float = math.nan
    kl: float = math.nan
    failure: str | None = None


@dataclass(frozen=True)
class RefinementRecord:
    """One refinement of an individual; numbers are None where no candidate was found.

    Attributes:
        generation: After whose selection it happened.
        outcome: "improved" where the tree is better than before on the same unseen episodes, "not_improved",
            "failed" where training broke off, "skipped" where no candidate was found.
        chosen: "best" or "random", as the first draw was, or "fittest" of its structure; None if skipped.
        redraws: Rejected candidates.
        individual: Index in the population of the tree that was refined.
        decision_nodes: Size of that tree.
        fitness_before: Its fitness on the training episodes.
        return_before: Its mean return on the measuring episodes.
        soft_return: Mean return of the soft tree's episodes in the last update.
        return_after: Mean return of the hardened tree on the measuring episodes.
        return_snapped: Mean return on them of the tree that the grammar's constants leave of it; None without
            write-back, or where no genotype holds the tree.
        written_back: Whether the snapped tree took its source's place in the population.
        new_best: Whether that exceeds the generation's best fitness, refined trees included.
        thresholds_moved: Thresholds that changed.
        largest_threshold_move: Largest change of a threshold.
        leaves_changed: Leaves whose action changed.
        timesteps: Environment steps sampled.
        updates: Batches of samples.
        gradient_steps: Optimiser steps.
        actor_loss: Clipped surrogate at the last step.
        critic_loss: Value loss at the last step.
        clip_fraction: Share of clipped ratios at the last step.
        kl: Approximate divergence from the sampling policy at the last step.
        failure: What broke, or None.
        refine_seconds: Clock time.
    """

    generation: int
    outcome: str
    redraws: int
    chosen: str | None = None
    individual: int | None = None
    decision_nodes: int | None = None
    fitness_before: float | None = None
    return_before: float | None = None
    soft_return: float | None = None
    return_after: float | None = None
    new_best: bool = False
    thresholds_moved: int | None = None
    largest_threshold_move: float | None = None
    leaves_changed: int | None = None
    timesteps: int | None = None
    updates: int | None = None
    gradient_steps: int | None = None
    actor_loss: float | None = None
    critic_loss: float | None = None
    clip_fraction: float | None = None
    kl: float | None = None
    failure: str | None = None
    refine_seconds: float = 0.0
    return_snapped: float | None = None
    written_back: bool = False


@dataclass(frozen=True)
class HallOfFameRecord:
    """The best tree of one size.

    Attributes:
        decision_nodes: Its size, pruned.
        depth: Its depth.
        complexity_M: Its complexity by Eq. 4.
        archive_mean: Mean return on the archive's episodes, which kept it; None for a champion too large for it.
        validation_mean: Mean return on the validation episodes, which chose it among the trees of its size.
        test_mean: Mean return on the run's test episodes, which chose nothing.
        test_std: Standard deviation of these returns.
        origin: "population", "refinement" for a refined individual, "neighbour" for a tree refined in exploring.
    """

    decision_nodes: int
    depth: int
    complexity_M: float  # noqa: N815 (the paper's symbol)
    archive_mean: float | None
    validation_mean: float
    test_mean: float
    test_std: float
    origin: str


@dataclass(frozen=True)
class Summary:
    """What a run found; all that a table needs of it.

    Attributes:
        environment: Gymnasium id.
        seed: Seed of the run.
        solved: Whether the test mean reaches the environment's threshold; None where it has none.
        train_fitness: The champion's fitness on its few training episodes, as the thesis reports it.
        validation_mean: Its mean return on the validation episodes that chose it.
        test_mean: Mean return of the pruned champion on unseen episodes.
        test_std: Standard deviation of these returns.
        test_episodes: Their number.
        test_mean_full: Mean return of the unpruned champion on the same episodes: what pruning cost.
        decision_nodes: Of the pruned champion.
        depth: Of the pruned champion.
        complexity_M: Its complexity by Eq. 4.
        generations: Generations run, the first population included.
        stopped_by: "generations", "solved", "max_seconds", "max_env_steps" or "interrupt".
        env_steps: Environment steps of evolution and of refinements.
        env_steps_total: With the final refinements, the hall of fame, validation, pruning and test.
        refinements: Refinements of individuals, skipped ones not counted.
        refinements_improved: Those that made the tree better on the same unseen episodes.
        champion_from: "population", "refinement" if the champion is a refined individual, or "neighbour" if it is a
            tree refined in exploring from the hall of fame.
        evolve_seconds: Clock time of evolution, refinements included.
        refine_seconds: Clock time of the refinements.
        wall_seconds: Clock time of the whole run.
        invalid_fraction: Share of all individuals ever made that have no tree.
        route: "compiled" or "gymnasium".
        solved_at: The threshold, or None.
        version: Of ge_torchrl.
        explored: Trees refined in exploring from the hall of fame.
        explore_seconds: Clock time of exploring, the final refinements included.
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
    env_steps_total: int
    refinements: int
    refinements_improved: int
    champion_from: str
    evolve_seconds: float
    refine_seconds: float
    wall_seconds: float
    invalid_fraction: float
    route: str
    solved_at: float | None
    version: str
    explored: int = 0
    explore_seconds: float = 0.0
