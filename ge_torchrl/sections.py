"""The sections of a run's settings: frozen records whose types and ranges are checked where they are made."""

from dataclasses import dataclass, field
from typing import ClassVar

from ge_torchrl.checks import (
    check_choice,
    check_flag,
    check_integer,
    check_integers,
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
        check_flag(self, "stop_when_solved")
        check_number(self, "max_seconds", above=0.0, optional=True)
        check_integer(self, "max_env_steps", 1, "a run needs steps to measure fitness", optional=True)


@dataclass(frozen=True)
class EvaluationConfig:
    """How many episodes measure a tree, and on how many threads.

    Attributes:
        episodes: Episodes whose mean return is an individual's fitness.
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
    episode_seeds: str = "fixed"
    validation_episodes: int = 100
    champion_candidates: int = 10
    test_episodes: int = 100
    threads: int = 0

    def __post_init__(self) -> None:
        check_integer(self, "episodes", 1, "fitness is a mean over episodes")
        check_choice(self, "episode_seeds", ("fixed", "fresh", "common"))
        check_integer(self, "validation_episodes", 1, "validation is a mean over episodes")
        check_integer(self, "champion_candidates", 1, "a run ends with one champion")
        check_integer(self, "test_episodes", 1, "the test is a mean over episodes")
        check_integer(self, "threads", 0, "it counts threads; 0 takes all cores")


@dataclass(frozen=True)
class ScheduleConfig:
    """In which generations a tree is refined.

    Attributes:
        every: After every so many generations, counted from 0 and not in generation 0; or None.
        generations: In exactly these, whatever `every` says; empty leaves it to `every`.
    """

    SECTION: ClassVar[str] = "ppo.schedule"

    every: int | None = None
    generations: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        check_integer(self, "every", 1, "it counts generations", optional=True)
        check_integers(self, "generations", 1, "generation 0 is random and not refined")

    def applies_to(self, generation: int) -> bool:
        """Tell whether a tree is refined in this generation."""
        if self.generations:
            return generation in self.generations
        return self.every is not None and generation > 0 and generation % self.every == 0


@dataclass(frozen=True)
class PPOConfig:
    """Refinement of trees by PPO.

    Attributes:
        name: "none" for grammatical evolution alone; any other name is what reports call the method.
        schedule: When a tree is refined.
        best_probability: Probability that the best tree is chosen, else a random one.
        measuring_episodes: Unseen episodes that measure a tree before and after its refinement.
        alpha: Steepness of the soft decisions.
        leaf_sd: Standard deviation of the noise on the leaves of a softened tree.
        max_timesteps: Environment steps of one refinement.
        update_timesteps: Environment steps between updates.
        epochs: Gradient steps on the samples of each update.
        clip_epsilon: Clipping of the probability ratio.
        gamma: Discount factor.
        gae_lambda: Decay of generalised advantage estimation; inferred.
        lr_actor: Learning rate of the tree.
        lr_critic: Learning rate of the critic.
        entropy_coeff: Weight of the entropy bonus; inferred.
        critic_coeff: Weight of the value loss; inferred.
        critic_hidden: Widths of the critic's hidden layers; inferred.
        source: Where samples come from: "collector" (TorchRL's, every environment), "fused" (compiled, where
            there are compiled dynamics), or "auto": fused where possible.
        candidates: Trees refined in a scheduled generation, one after another; those after the first are random.
        write_back: Whether a refined tree, snapped to the grammar's constants, takes its source's place in the
            population if it is fitter there. The thesis keeps refined trees apart.
        snapshot_episodes: Episodes on which the hard tree is scored after every update, so that the best one
            comes back; 0 brings back the last one, as in the thesis.
    """

    SECTION: ClassVar[str] = "ppo"

    name: str = "none"
    schedule: ScheduleConfig = field(default_factory=ScheduleConfig)
    best_probability: float = 0.5
    measuring_episodes: int = 50
    alpha: float = 1000.0
    leaf_sd: float = 0.1
    max_timesteps: int = 100_000
    update_timesteps: int = 3000
    epochs: int = 60
    clip_epsilon: float = 0.2
    gamma: float = 0.95
    gae_lambda: float = 0.95
    lr_actor: float = 0.001
    lr_critic: float = 0.001
    entropy_coeff: float = 0.01
    critic_coeff: float = 0.5
    critic_hidden: tuple[int, ...] = (64, 64)
    source: str = "auto"
    candidates: int = 1
    write_back: bool = False
    snapshot_episodes: int = 0

    def __post_init__(self) -> None:
        check_text(self, "name", "none, or the name of a method")
        if not isinstance(self.schedule, ScheduleConfig):
            refuse(self, "schedule", "a ScheduleConfig")
        check_probability(self, "best_probability")
        check_integer(self, "measuring_episodes", 1, "a return is a mean over episodes")
        check_number(self, "alpha", above=0.0)
        check_number(self, "leaf_sd", at_least=0.0)
        check_integer(self, "max_timesteps", 1, "PPO learns from samples")
        check_integer(self, "update_timesteps", 2, "PPO learns from samples")
        if self.update_timesteps > self.max_timesteps:
            refuse(self, "update_timesteps", f"at most ppo.max_timesteps, {self.max_timesteps}")
        check_integer(self, "epochs", 1, "an update is at least one gradient step")
        check_number(self, "clip_epsilon", above=0.0)
        check_probability(self, "gamma", "it is a discount factor")
        check_probability(self, "gae_lambda", "it is a decay")
        for name in ("lr_actor", "lr_critic"):
            check_number(self, name, above=0.0)
        for name in ("entropy_coeff", "critic_coeff"):
            check_number(self, name, at_least=0.0)
        check_integers(self, "critic_hidden", 1, "it counts units of a layer")
        check_choice(self, "source", ("auto", "collector", "fused"))
        check_integer(self, "candidates", 1, "an application refines at least one tree")
        check_flag(self, "write_back")
        check_integer(self, "snapshot_episodes", 0, "it counts episodes; 0 takes the last tree")

    @property
    def enabled(self) -> bool:
        """Whether there is any refinement."""
        return self.name != "none"
