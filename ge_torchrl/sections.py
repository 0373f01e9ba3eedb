"""The sections of a run's settings: frozen records whose types and ranges are checked where they are made."""

from dataclasses import dataclass
from typing import ClassVar

from ge_torchrl.checks import (
    check_choice,
    check_flag,
    check_integer,
    check_names,
    check_number,
    check_probability,
    check_text,
    refuse,
)


@dataclass(frozen=True)
class EnvironmentConfig:
    """Which environment, what its numbers are called, and how its episodes are run.

    Attributes:
        id: Gymnasium id, such as `CartPole-v1`.
        features: [D] names of the observation's entries; empty means `x0`, `x1`, ...
        units: [D] their units, an empty string where there is none; empty means none at all.
        actions: [A] names of the actions; empty means `a0`, `a1`, ...
        solved_at: Mean return from which the task counts as solved, or None.
        lowest_fitness_excluded: A tree with this fitness, the lowest possible, is no candidate for PPO; or
            None.
        route: "compiled" kernels, "gymnasium", or "auto": compiled where there is a kernel.
        max_episode_steps: Limit of an episode's length, or None for the environment's own.
        workers: Worker processes of the Gymnasium route; 0 decides by itself.
    """

    SECTION: ClassVar[str] = "env"

    id: str
    features: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    actions: tuple[str, ...] = ()
    solved_at: float | None = None
    lowest_fitness_excluded: float | None = None
    route: str = "auto"
    max_episode_steps: int | None = None
    workers: int = 0

    def __post_init__(self) -> None:
        check_text(self, "id", "a Gymnasium id such as CartPole-v1")
        check_names(self, "features", distinct=True)
        check_names(self, "units", distinct=False)
        check_names(self, "actions", distinct=True)
        if self.units and len(self.units) != len(self.features):
            refuse(
                self, "units", "one unit for each feature", "an empty text stands for a feature without unit"
            )
        check_number(self, "solved_at", optional=True)
        check_number(self, "lowest_fitness_excluded", optional=True)
        check_choice(self, "route", ("auto", "gymnasium", "compiled"))
        check_integer(self, "max_episode_steps", 1, "an episode has at least one step", optional=True)
        check_integer(self, "workers", 0, "it counts processes; 0 decides by itself")


@dataclass(frozen=True)
class GrammarConfig:
    """The grammar that turns codons into trees.

    Attributes:
        name: What reports call it.
        bnf: Its rules in Backus-Naur form.
    """

    SECTION: ClassVar[str] = "grammar"

    name: str
    bnf: str

    def __post_init__(self) -> None:
        check_text(self, "name", "the name of the grammar")
        check_text(self, "bnf", "rules in Backus-Naur form")


@dataclass(frozen=True)
class GEConfig:
    """Grammatical evolution: sizes, probabilities, and when to stop.

    Attributes:
        population_size: Individuals in a generation, `P`.
        generations: Generations, the random first one, number 0, included.
        genotype_length: Codons in a genotype, `K`; fixed.
        gene_probability: Probability that uniform mutation redraws a codon of an individual that is mutated.
        crossover_probability: Probability that a pair of parents is crossed over.
        mutation_probability: Probability that an individual is mutated.
        tournament_size: Individuals drawn for a tournament; 2 is usual in this line of work, the thesis gives
            none.
        wraps: How often the mapping may read a genotype again from its start.
        single_choice_consumes: Whether a rule with a single production reads a codon too. The thesis does not
            say; false is inferred.
        replacement: "parent_if_better": an offspring takes its parent's place if it is fitter, as in the thesis;
            "generational": the offspring are the next generation.
        elites: Best individuals that keep their places whatever the offspring are.
        parsimony: "none": fitness alone decides, as in the thesis; "lexicographic": of individuals that are about
            equally fit the one with fewer decision nodes is better, in tournaments and in replacement.
        parsimony_tolerance: Largest difference of the fitness of individuals that are about equally fit.
        stop_when_solved: Whether the run ends with the first champion that solves the task.
        max_seconds: Time after which the run ends early, or None.
        max_env_steps: Environment steps after which the run ends early, or None.
    """

    SECTION: ClassVar[str] = "ge"

    population_size: int
    generations: int
    genotype_length: int
    gene_probability: float
    crossover_probability: float = 0.0
    mutation_probability: float = 1.0
    tournament_size: int = 2
    wraps: int = 0
    single_choice_consumes: bool = False
    replacement: str = "parent_if_better"
    elites: int = 0
    parsimony: str = "none"
    parsimony_tolerance: float = 0.0
    stop_when_solved: bool = False
    max_seconds: float | None = None
    max_env_steps: int | None = None

    def __post_init__(self) -> None:
        check_integer(self, "population_size", 2, "selection compares individuals")
        check_integer(self, "generations", 1, "generation 0 is the random first population")
        check_integer(self, "genotype_length", 1, "a tree is read from codons")
        for name in ("gene_probability", "crossover_probability", "mutation_probability"):
            check_probability(self, name)
        check_integer(self, "tournament_size", 1, "a tournament draws individuals; 1 is random choice")
        check_integer(self, "wraps", 0, "it counts readings after the first")
        check_flag(self, "single_choice_consumes")
        check_choice(self, "replacement", ("parent_if_better", "generational"))
        check_integer(self, "elites", 0, "it counts individuals")
        if self.elites >= self.population_size:
            expected = f"less than ge.population_size, {self.population_size}"
            refuse(self, "elites", expected, "a population of elites alone never changes")
        check_choice(self, "parsimony", ("none", "lexicographic"))
        check_number(self, "parsimony_tolerance", at_least=0.0)
        check_flag(self, "stop_when_solved")
        check_number(self, "max_seconds", above=0.0, optional=True)
        check_integer(self, "max_env_steps", 1, "a run needs steps to measure fitness", optional=True)


@dataclass(frozen=True)
class EvaluationConfig:
    """How many episodes measure a tree, and on how many threads.

    Attributes:
        episodes: Episodes whose mean return is an individual's fitness.
        std_penalty: Standard deviations of these returns that are subtracted from their mean. Fitness is then lower
            than the mean return, also where it is held against `env.solved_at` and `env.lowest_fitness_excluded`.
        episode_seeds: "fixed": the same episodes in every generation, as in the thesis' lineage; "fresh": new
            ones in every generation for the offspring, while parents keep their fitness; "common": new ones
            in every generation, on which parents are measured again.
        validation_episodes: Episodes that choose among the champions and prune them.
        champion_candidates: Best individuals that validation chooses from.
        test_episodes: Unseen episodes of the final test.
        threads: Threads of the compiled route; 0 takes all cores.
    """

    SECTION: ClassVar[str] = "evaluation"

    episodes: int
    std_penalty: float = 0.0
    episode_seeds: str = "fixed"
    validation_episodes: int = 100
    champion_candidates: int = 10
    test_episodes: int = 100
    threads: int = 0

    def __post_init__(self) -> None:
        check_integer(self, "episodes", 1, "fitness is a mean over episodes")
        check_number(self, "std_penalty", at_least=0.0)
        check_choice(self, "episode_seeds", ("fixed", "fresh", "common"))
        check_integer(self, "validation_episodes", 1, "validation is a mean over episodes")
        check_integer(self, "champion_candidates", 1, "a run ends with one champion")
        check_integer(self, "test_episodes", 1, "the test is a mean over episodes")
        check_integer(self, "threads", 0, "it counts threads; 0 takes all cores")


@dataclass(frozen=True)
class HallOfFameConfig:
    """The best trees of each size: how they are kept, and how the search goes on from them.

    In the generations of `refiner.schedule` the search goes on from kept trees as well as from the population: trees
    one or two edits away from kept ones are refined (`neighbours`), kept trees are refined again with more episodes
    (`revisits`), and kept trees return to the population (`migrants`).

    Attributes:
        enabled: Whether the best tree for each number of decision nodes is kept, tested and written.
        episodes: Episodes of its own that measure what is offered.
        keep: Trees of each size that are kept until validation chooses among them, each of another structure.
        max_nodes: Decision nodes of the largest trees.
        neighbours: Neighbours refined in a scheduled generation.
        neighbours_drawn: Neighbours drawn and measured on the training episodes, from which they are chosen.
        revisits: Kept trees refined again in a scheduled generation.
        revisit_factor: How many times the refiner's episodes and steps such a refinement takes.
        final_keep: Kept trees of each size that are refined once more after evolution; 0 leaves it out.
        final_factor: How many times the refiner's episodes and steps this takes.
        final_patience: How many times the steps, but not the episodes, beyond that.
        final_step: How many times the refiner's first step of thresholds, where the method has one.
        final_settling_episodes: Episodes on which the snapped thresholds of these trees are then moved to better
            constants near by; 0 leaves each at the nearest one.
        migrants: Kept trees that take the places of the least fit individuals after a scheduled generation.
    """

    SECTION: ClassVar[str] = "hall_of_fame"

    enabled: bool = False
    episodes: int = 200
    keep: int = 3
    max_nodes: int = 15
    neighbours: int = 0
    neighbours_drawn: int = 500
    revisits: int = 0
    revisit_factor: int = 5
    final_keep: int = 0
    final_factor: int = 20
    final_patience: int = 1
    final_step: float = 1.0
    final_settling_episodes: int = 0
    migrants: int = 0

    def __post_init__(self) -> None:
        check_flag(self, "enabled")
        check_integer(self, "episodes", 1, "trees are kept by a mean over episodes")
        check_integer(self, "keep", 1, "the hall of fame has a tree of each size")
        check_integer(self, "max_nodes", 0, "a lone leaf has no decision node")
        check_integer(self, "neighbours", 0, "it counts trees")
        check_integer(self, "neighbours_drawn", 1, "neighbours are chosen among those drawn")
        check_integer(self, "revisits", 0, "it counts trees")
        check_integer(self, "revisit_factor", 1, "a revisit measures at least as well as a first refinement")
        check_integer(self, "final_keep", 0, "it counts trees")
        check_integer(self, "final_factor", 1, "it multiplies a budget")
        check_integer(self, "final_patience", 1, "it multiplies a budget")
        check_number(self, "final_step", above=0.0)
        check_integer(self, "final_settling_episodes", 0, "it counts episodes; 0 leaves snapped thresholds")
        check_integer(self, "migrants", 0, "it counts individuals")
