"""The settings of refinement: frozen records whose types and ranges are checked where they are made."""

from dataclasses import dataclass, field
from typing import ClassVar

from ge_torchrl.checks import (
    check_choice,
    check_flag,
    check_integer,
    check_integers,
    check_number,
    check_probability,
    check_text,
    refuse,
)


@dataclass(frozen=True)
class ScheduleConfig:
    """In which generations a tree is refined.

    Attributes:
        every: After every so many generations, counted from 0 and not in generation 0; or None.
        generations: In exactly these, whatever `every` says; empty leaves it to `every`.
    """

    SECTION: ClassVar[str] = "refiner.schedule"

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
    """Refinement of one tree by PPO: budget, hyperparameters, and which hard tree comes back.

    Attributes:
        alpha: Steepness of the soft decisions.
        leaf_sd: Standard deviation of the noise on the leaves of a softened tree.
        leaf_scale: How nearly a softened leaf always chooses its action; 1 is the thesis' Eq. 3.
        max_timesteps: Environment steps of one refinement.
        update_timesteps: Environment steps between updates.
        epochs: Passes over the samples of each update.
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
        scale_features: Whether steepness and learning rate of a threshold count in units of its feature's
            standard deviation over a first batch of samples; `alpha` then wants to be far smaller.
        scale_critic: Whether the critic counts features and values in units of their standard deviations over that
            first batch.
        alpha_final: Steepness in the last update, reached geometrically from `alpha`; None keeps `alpha`.
        lr_thresholds: Learning rate of the thresholds; None takes `lr_actor`.
        optimizer: "rmsprop", as in the thesis, or "adam".
        minibatch_size: Samples of a gradient step; None takes all samples of an update.
        entropy_final: Weight of the entropy bonus in the last update, reached linearly; None keeps
            `entropy_coeff`.
        snapshot_episodes: Episodes on which the hard tree is scored after every update, so that the best one
            comes back; 0 brings back the last one, as in the thesis.
    """

    SECTION: ClassVar[str] = "refiner.ppo"

    alpha: float = 1000.0
    leaf_sd: float = 0.1
    leaf_scale: float = 1.0
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
    scale_features: bool = False
    scale_critic: bool = False
    alpha_final: float | None = None
    lr_thresholds: float | None = None
    optimizer: str = "rmsprop"
    minibatch_size: int | None = None
    entropy_final: float | None = None
    snapshot_episodes: int = 0

    def __post_init__(self) -> None:
        check_number(self, "alpha", above=0.0)
        check_number(self, "leaf_sd", at_least=0.0)
        check_number(self, "leaf_scale", above=0.0)
        check_integer(self, "max_timesteps", 1, "PPO learns from samples")
        check_integer(self, "update_timesteps", 2, "PPO learns from samples")
        if self.update_timesteps > self.max_timesteps:
            refuse(self, "update_timesteps", f"at most refiner.ppo.max_timesteps, {self.max_timesteps}")
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
        self._check_gradients()
        check_integer(self, "snapshot_episodes", 0, "it counts episodes; 0 takes the last tree")

    def _check_gradients(self) -> None:
        for name in ("scale_features", "scale_critic"):
            check_flag(self, name)
            if getattr(self, name) and self.max_timesteps < 2 * self.update_timesteps:
                expected = (
                    "false where refiner.ppo.max_timesteps is less than two of refiner.ppo.update_timesteps"
                )
                refuse(self, name, expected, "the first batch of samples only measures the spreads")
        for name in ("alpha_final", "lr_thresholds"):
            check_number(self, name, above=0.0, optional=True)
        check_choice(self, "optimizer", ("rmsprop", "adam"))
        check_integer(
            self, "minibatch_size", 2, "advantages are normalised by their deviation", optional=True
        )
        check_number(self, "entropy_final", at_least=0.0, optional=True)


@dataclass(frozen=True)
class CMAESConfig:
    """Refinement of one tree without gradients: its leaves one by one, then its thresholds, at last by CMA-ES.

    Attributes:
        max_timesteps: Environment steps of one refinement.
        max_seconds: Clock time of one refinement, instead of `max_timesteps`; None counts steps. By the clock two
            runs of one seed differ.
        episodes: Episodes that each tree is measured on.
        first_step: Standard deviation of the first moves of thresholds, in units of their features' spread.
        moves: Moves of each threshold by itself that are tried before CMA-ES moves all together, and tried again for
            as long as one makes the tree better; 0 leaves them to CMA-ES.
        screening_episodes: The first so many of the episodes tell which of these moves are worth the others; 0
            measures all moves on all episodes.
    """

    SECTION: ClassVar[str] = "refiner.cmaes"

    max_timesteps: int = 100_000
    max_seconds: float | None = None
    episodes: int = 5
    first_step: float = 0.3
    moves: int = 0
    screening_episodes: int = 0

    def __post_init__(self) -> None:
        check_integer(self, "max_timesteps", 1, "trees are measured by their steps in the environment")
        check_number(self, "max_seconds", above=0.0, optional=True)
        check_integer(self, "episodes", 1, "a return is a mean over episodes")
        check_number(self, "first_step", above=0.0)
        check_integer(self, "moves", 0, "it counts trees; 0 leaves thresholds to CMA-ES")
        check_integer(self, "screening_episodes", 0, "it counts episodes; 0 takes all")


@dataclass(frozen=True)
class RefinerConfig:
    """Refinement of trees: by which method, when, which trees, and what becomes of them.

    Attributes:
        name: "none" for grammatical evolution alone; any other name is what reports call the settings.
        method: "ppo", or "cmaes": without gradients.
        schedule: When trees are refined.
        candidates: Trees of the population refined in a scheduled generation, one after another.
        choice: Which ones: "best_or_random", one of the best tree or a random one and the others at random, as in the
            thesis; or "each_size", the fittest of every number of decision nodes and then the next of every number,
            those first whose structure was refined least often.
        min_nodes: Decision nodes of the smallest trees that are refined; the thesis refines trees from two on.
        best_probability: Probability that the first of "best_or_random" is the best tree.
        probability: Probability that a tree that was chosen is refined.
        simplify: Whether a tree is refined, and written back, without what no state can reach. The thesis refines it
            whole.
        acceptance_episodes: Unseen episodes on which a refined tree has to be better than its source, or the source
            comes back as it was; 0 accepts every tree, as in the thesis.
        acceptance_errors: Standard errors of the mean difference by which it has to be better.
        measuring_episodes: Unseen episodes that measure a tree before and after its refinement.
        write_back: Whether a refined tree, snapped to the grammar's constants, takes its source's place in the
            population if it is fitter there. The thesis keeps refined trees apart.
        ppo: The settings of PPO.
        cmaes: The settings of CMA-ES.
    """

    SECTION: ClassVar[str] = "refiner"

    name: str = "none"
    method: str = "ppo"
    schedule: ScheduleConfig = field(default_factory=ScheduleConfig)
    candidates: int = 1
    choice: str = "best_or_random"
    min_nodes: int = 2
    best_probability: float = 0.5
    probability: float = 1.0
    simplify: bool = False
    acceptance_episodes: int = 0
    acceptance_errors: float = 0.0
    measuring_episodes: int = 50
    write_back: bool = False
    ppo: PPOConfig = field(default_factory=PPOConfig)
    cmaes: CMAESConfig = field(default_factory=CMAESConfig)

    def __post_init__(self) -> None:
        check_text(self, "name", "none, or the name of a method")
        check_choice(self, "method", ("ppo", "cmaes"))
        for name, section in (("schedule", ScheduleConfig), ("ppo", PPOConfig), ("cmaes", CMAESConfig)):
            if not isinstance(getattr(self, name), section):
                refuse(self, name, f"a {section.__name__}")
        check_integer(self, "candidates", 1, "an application refines at least one tree")
        check_choice(self, "choice", ("best_or_random", "each_size"))
        check_integer(self, "min_nodes", 1, "a lone leaf has nothing to refine")
        check_probability(self, "best_probability")
        check_probability(self, "probability")
        check_flag(self, "simplify")
        check_integer(self, "acceptance_episodes", 0, "it counts episodes; 0 accepts every tree")
        check_number(self, "acceptance_errors", at_least=0.0)
        check_integer(self, "measuring_episodes", 1, "a return is a mean over episodes")
        check_flag(self, "write_back")

    @property
    def enabled(self) -> bool:
        """Whether there is any refinement."""
        return self.name != "none"
