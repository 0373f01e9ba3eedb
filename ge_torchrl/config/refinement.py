"""The settings of refinement: when and which trees, PPO, and the polish."""

import operator
from dataclasses import dataclass, field
from typing import ClassVar

from ge_torchrl.checks import MOST_TREES
from ge_torchrl.config.setting import Section, episode_count, probability, setting

# Trees that are trained as one batch where nobody says otherwise, what a sample and a weight of theirs take at least,
# and what all of them may take [bytes].
_TREES_TOGETHER, _SAMPLE_BYTES, _WEIGHT_BYTES, _MOST_BYTES = 32, 64, 16, 8 << 30


@dataclass(frozen=True)
class ScheduleConfig(Section):
    """In which generations trees are refined."""

    SECTION: ClassVar[str] = "refiner.schedule"

    every: int = setting(
        10,
        at_least=0,
        because="it counts generations; 0 leaves it to refiner.schedule.generations",
        dear=3,
        doc="After every so many generations, counted from 0 and not in generation 0; 0: none.",
    )
    generations: tuple[int, ...] = setting(
        (),
        at_least=1,
        because="generation 0 is random and not refined",
        doc="In exactly these, whatever `every` says; empty leaves it to `every`.",
    )

    def applies_to(self, generation: int) -> bool:
        """Tell whether trees are refined in this generation."""
        if self.generations:
            return generation in self.generations
        return _is_due(self.every, generation)


@dataclass(frozen=True)
class PPOConfig(Section):
    """Refinement of trees by PPO: budget, hyperparameters, and which hard tree comes back."""

    SECTION: ClassVar[str] = "refiner.ppo"

    max_timesteps: int = setting(
        40_000,
        at_least=2,
        because="PPO learns from samples",
        doc="Environment steps of one tree's refinement.",
    )
    update_timesteps: int = setting(
        1000, at_least=2, because="PPO learns from samples", doc="Environment steps between updates."
    )
    epochs: int = setting(
        4,
        at_least=1,
        because="an update is at least one gradient step",
        doc="Passes over the samples of each update.",
    )
    minibatch_size: int | None = setting(
        None,
        at_least=2,
        because="advantages are normalised by their deviation",
        doc="Samples of a gradient step; null takes all samples of an update.",
    )
    optimizer: str = setting("adam", choices=("adam", "rmsprop"), doc="The thesis takes `rmsprop`.")
    lr_actor: float = setting(0.05, above=0.0, doc="Learning rate of the tree.")
    lr_critic: float = setting(0.03, above=0.0, doc="Learning rate of the critic.")
    clip_epsilon: float = setting(0.2, above=0.0, doc="Clipping of the probability ratio.")
    gamma: float = probability(0.995, because="it is a discount factor", doc="Discount factor.")
    gae_lambda: float = probability(
        0.98, because="it is a decay", doc="Decay of generalised advantage estimation."
    )
    entropy_coeff: float = setting(0.01, at_least=0.0, doc="Weight of the entropy bonus.")
    entropy_final: float | None = setting(
        0.0,
        at_least=0.0,
        doc="Weight of the entropy bonus in the last update, reached linearly; null keeps `entropy_coeff`.",
    )
    critic_hidden: tuple[int, ...] = setting(
        (32, 32),
        at_least=1,
        because="it counts units of a layer",
        doc="Widths of the critic's hidden layers.",
    )
    alpha: float = setting(5.0, above=0.0, doc="Steepness of the soft decisions.")
    leaf_logit: float | None = setting(
        4.0,
        above=0.0,
        doc="Lead of a softened leaf's action over the others, in logits; null is the thesis' Eq. 3: one less than "
        "there are actions.",
    )
    standardise: bool = setting(
        True,
        doc="Whether steepness and learning rate of a threshold, and the critic's features and values, count in units "
        "of standard deviations over a first batch of samples; `alpha` then wants to be far smaller.",
    )
    straight_through: bool = setting(
        False, doc="Whether splits decide hard in the forward pass and soft in the backward pass."
    )
    trees_together: int | None = setting(
        None,
        largest=MOST_TREES,
        at_least=1,
        because="a batch has a tree",
        doc="Trees that are trained as one batch; null: 32, and fewer where copies of the environment are large. It "
        "decides the last bits of what PPO learns.",
    )
    snapshot_episodes: int = episode_count(
        100,
        at_least=0,
        because="it counts episodes (0 takes the last tree)",
        dear=10,
        doc="Episodes on which the hard tree is measured after every update, so that the best one comes back; 0 "
        "brings back the last one, as in the thesis.",
    )

    def check_together(self) -> None:
        """Refuse budgets that leave no update to learn from."""
        if self.update_timesteps > self.max_timesteps:
            self.refuse(
                "update_timesteps",
                f"at most refiner.ppo.max_timesteps, {self.max_timesteps}",
                "an update waits for its samples",
                self.max_timesteps if self.max_timesteps >= 2 else None,
            )
        if self.standardise and self.max_timesteps < 2 * self.update_timesteps:
            self.refuse(
                "standardise",
                "false where refiner.ppo.max_timesteps is less than two of refiner.ppo.update_timesteps",
                "the first batch of samples only measures the spreads",
                "false",
            )
        self._check_memory()

    def _check_memory(self) -> None:
        """Refuse batches of samples and networks that fit into no memory."""
        together = self.trees_together or _TREES_TOGETHER
        at_most = _MOST_BYTES // (together * _SAMPLE_BYTES)
        if self.update_timesteps > at_most:
            self.refuse(
                "update_timesteps",
                f"at most {at_most} where {together} trees are trained together",
                f"a sample takes {_SAMPLE_BYTES} bytes and more, and {_MOST_BYTES >> 30} GiB are allowed",
                max(2, at_most),
            )
        widths = (1, *self.critic_hidden, 1)
        n_bytes = together * _WEIGHT_BYTES * sum(map(operator.mul, widths, widths[1:]))
        if n_bytes > _MOST_BYTES:
            self.refuse(
                "critic_hidden",
                f"networks that take at most {_MOST_BYTES >> 30} GiB where {together} trees are trained together",
                f"a weight takes {_WEIGHT_BYTES} bytes with what its optimiser keeps, so these take "
                f"{n_bytes >> 30} GiB",
            )


@dataclass(frozen=True)
class PolishConfig(Section):
    """Local search without gradients: leaves one by one, then the numbers of the tree, at last by CMA-ES.

    It polishes what the refiner found wherever steps are nearly free, and is the refiner itself with `refiner=cmaes`.
    """

    SECTION: ClassVar[str] = "polish"

    every: int = setting(
        1,
        at_least=0,
        because="it counts generations; 0 polishes nothing",
        dear=0,
        doc="After every so many generations, not in generation 0; 0: no polish.",
    )
    max_timesteps: int = setting(
        300_000,
        at_least=1,
        because="trees are measured by their steps in the environment",
        doc="Environment steps of one tree's search.",
    )
    episodes: int = episode_count(
        40,
        because="a return is a mean over episodes",
        doc="Episodes that each tree is measured on.",
    )
    moves: int = setting(
        0,
        at_least=0,
        because="it counts trees; 0 leaves the numbers to CMA-ES",
        doc="Moves of each number by itself that are tried before CMA-ES moves all together, and again for as long as "
        "one makes the tree better. A quarter of the episodes tells which of them are worth the others.",
    )
    first_step: float = setting(
        0.5, above=0.0, doc="Standard deviation of the first moves, in units of the features' spread."
    )
    settling_episodes: int = episode_count(
        0,
        at_least=0,
        because="it counts episodes (0 leaves snapped numbers)",
        doc="Episodes on which the snapped numbers of the last refinement are moved to better constants near by; 0 "
        "leaves each at the nearest one.",
    )

    @property
    def enabled(self) -> bool:
        """Whether there is any polish."""
        return self.every != 0

    def applies_to(self, generation: int) -> bool:
        """Tell whether trees are polished in this generation."""
        return _is_due(self.every, generation)


@dataclass(frozen=True)
class RefinerConfig(Section):
    """Refinement of trees: by which method, when, which trees, and what becomes of them."""

    SECTION: ClassVar[str] = "refiner"

    method: str = setting(
        "ppo",
        choices=("ppo", "cmaes", "none"),
        doc="`ppo`; `cmaes`: the local search of `polish` in its place; `none`: grammatical evolution alone.",
    )
    schedule: ScheduleConfig = field(default_factory=ScheduleConfig)
    candidates: int = setting(
        1,
        largest=MOST_TREES,
        at_least=1,
        because="a scheduled generation refines at least one tree",
        dear=2,
        doc="Individuals of the population that are refined in a scheduled generation.",
    )
    choice: str = setting(
        "each_size",
        choices=("each_size", "best_or_random"),
        doc="Which ones: `each_size`: the fittest of every number of decision nodes, those first whose structure was "
        "refined least often; `best_or_random`: the best or a random one, as likely, as in the thesis.",
    )
    min_nodes: int = setting(
        2,
        at_least=1,
        because="a lone leaf has nothing to refine",
        doc="Decision nodes of the smallest trees that are refined.",
    )
    acceptance_episodes: int = episode_count(
        1000,
        at_least=0,
        because="it counts episodes (0 accepts every tree)",
        dear=60,
        doc="Unseen episodes on which a refined tree has to be better by three standard errors of the mean "
        "difference, or its source comes back as it was; 0 accepts every tree, as in the thesis.",
    )
    measuring_episodes: int = episode_count(
        100,
        because="a return is a mean over episodes",
        dear=30,
        doc="Unseen episodes that measure a tree before and after its refinement.",
    )
    write_back: bool = setting(
        True,
        doc="Whether a refined tree, snapped to the grammar's constants, takes its source's place in the population if "
        "it is fitter there. It is then refined without what no state can reach. The thesis refines whole trees and "
        "keeps them apart.",
    )
    ppo: PPOConfig = field(default_factory=PPOConfig)

    @property
    def enabled(self) -> bool:
        """Whether there is a refiner."""
        return self.method != "none"


def _is_due(every: int, generation: int) -> bool:
    return every > 0 and generation > 0 and generation % every == 0
