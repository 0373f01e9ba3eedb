"""The settings of grammar, evolution and measuring."""

from dataclasses import dataclass
from typing import ClassVar

from ge_torchrl.config.environment import MOST_THREADS
from ge_torchrl.config.setting import Section, episode_count, probability, setting

_POPULATION_SIZE = 200
_MOST_CODONS = (8 << 30) // 4
# Of one genotype, again and again.
_MOST_READINGS = 10_000_000


@dataclass(frozen=True)
class GrammarConfig(Section):
    """The grammar that turns codons into trees."""

    SECTION: ClassVar[str] = "grammar"

    bnf: str | None = setting(
        None,
        doc="Its rules in Backus-Naur form; null makes them for the environment, from what its features are in play. "
        "The run's `config.yaml` holds what was made.",
        text="rules in Backus-Naur form",
        lines=True,
    )
    splits: str | None = setting(
        None,
        choices=("axis", "oblique"),
        doc="What decision nodes compare with a constant: `axis`: one feature; `oblique`: a weighted sum of features "
        "as well; null: what `grammar.bnf` says, else `axis`. Rules are made where `grammar.bnf` says otherwise.",
    )
    leaves: str | None = setting(
        None,
        choices=("action", "constant", "linear"),
        doc="What leaves answer: `action`: one of discrete actions; `constant`: numbers, where actions are continuous; "
        "`linear`: numbers plus a weighted sum of features; null: what `grammar.bnf` says, else `action` or `linear`. "
        "Rules are made where `grammar.bnf` says otherwise.",
    )
    name: str = setting("own", doc="What reports call it.", text="the name of the grammar")


@dataclass(frozen=True)
class GEConfig(Section):
    """Grammatical evolution: population, probabilities, and when to stop."""

    SECTION: ClassVar[str] = "ge"

    population_size: int = setting(
        _POPULATION_SIZE,
        at_least=2,
        because="selection compares individuals",
        dear=60,
        doc="Individuals in a generation, `P`.",
    )
    generations: int = setting(
        50,
        at_least=1,
        because="generation 0 is the random first population",
        doc="Generations, the random first one, number 0, included.",
    )
    genotype_length: int = setting(
        256,
        at_least=1,
        because="a tree is read from codons",
        largest=_MOST_READINGS,
        doc="Codons in a genotype, `K`; fixed.",
    )
    gene_probability: float = probability(
        0.05, doc="Probability that mutation redraws a codon of an individual that is mutated."
    )
    restarts: int = setting(
        0,
        at_least=0,
        because="it counts starts after the first",
        doc="How often the search begins anew with another population. The generations have as many equal parts, and "
        "two more: one for the first start, and a last one where the archives of all starts go on as one.",
    )
    crossover_probability: float = probability(0.0, doc="Probability that a pair of parents is crossed over.")
    mutation_probability: float = probability(1.0, doc="Probability that an individual is mutated.")
    tournament_size: int = setting(
        2,
        at_least=1,
        because="a tournament draws individuals; 1 is random choice",
        doc="Individuals drawn for a tournament.",
    )
    wraps: int = setting(
        0,
        at_least=0,
        because="it counts readings after the first",
        doc="How often the mapping may read a genotype again from its start.",
    )
    parsimony: str = setting(
        "lexicographic",
        choices=("lexicographic", "none"),
        doc="`lexicographic`: of equally fit individuals the one with fewer decision nodes is better; `none`: fitness "
        "alone decides, as in the thesis.",
    )
    stop_when_solved: bool = setting(
        False, doc="Whether the run ends with the first champion that solves the task."
    )
    max_seconds: float | None = setting(
        None,
        above=0.0,
        doc="Time that the whole run may take, with the look at the environment before it, which is short where there "
        "are few seconds; null: any. Compiling kernels, once on a machine, is not counted. Loading PyTorch takes some "
        "seconds of it, so that PPO hardly gets a turn below ten or fifteen.",
    )
    max_env_steps: int | None = setting(
        None,
        at_least=0,
        because="it counts steps; 0 is no limit",
        doc="Environment steps that the whole run may take, beside some thousand of the look at the environment before "
        "it; 0: any; null: any where steps are nearly free, elsewhere as many as plain evaluation makes in three "
        "minutes; with PPO they take several times as long.",
    )

    def check_together(self) -> None:
        """Refuse starts without generations, tournaments of more than all, populations that fit into no memory."""
        if self.restarts > max(0, self.generations - 2):
            self.refuse(
                "restarts",
                f"at most {max(0, self.generations - 2)} with ge.generations={self.generations}",
                "each start has a part of the generations, and one is for all together",
                max(0, self.generations - 2),
            )
        # Left open, it is never more than this.
        population_size = self.population_size or _POPULATION_SIZE
        if self.tournament_size > population_size:
            self.refuse(
                "tournament_size",
                f"at most ge.population_size, {population_size}",
                "a tournament draws from the population",
                population_size,
            )
        if self.wraps > 0 and (self.wraps + 1) * self.genotype_length > _MOST_READINGS:
            self.refuse(
                "wraps",
                f"at most {max(0, _MOST_READINGS // self.genotype_length - 1)} with "
                f"ge.genotype_length={self.genotype_length}",
                "what a genotype is read to is held in memory",
                max(0, _MOST_READINGS // self.genotype_length - 1),
            )
        n_codons = population_size * self.genotype_length
        if n_codons > _MOST_CODONS:
            # Whichever is the larger of the two is the one that was meant to be smaller.
            large, other = "population_size", "genotype_length"
            if self.genotype_length > population_size:
                large, other = other, large
            at_most = _MOST_CODONS // (getattr(self, other) or population_size)
            self.refuse(
                large,
                f"at most {at_most} with ge.{other}={getattr(self, other) or population_size}",
                f"the codons of a population take 4 bytes each, here {n_codons * 4 / (1 << 30):.0f} GiB, and 8 GiB are "
                "allowed",
                at_most,
            )


@dataclass(frozen=True)
class EvaluationConfig(Section):
    """How many episodes measure a tree, and on how many threads."""

    SECTION: ClassVar[str] = "evaluation"

    episodes: int = episode_count(
        20,
        because="fitness is a mean over episodes",
        dear=5,
        doc="Episodes whose mean return is an individual's fitness.",
    )
    episode_seeds: str = setting(
        "common",
        choices=("common", "fixed", "fresh"),
        doc="`common`: new episodes in every generation, on which parents are measured again; `fixed`: the same in "
        "every generation, as in the thesis; `fresh`: new ones for the offspring, while parents keep their fitness.",
    )
    std_penalty: float = setting(
        0.0,
        at_least=0.0,
        doc="Standard deviations of these returns that are subtracted from their mean. Fitness is then lower than the "
        "mean return.",
    )
    validation_episodes: int = episode_count(
        5000,
        because="validation is a mean over episodes",
        dear=200,
        doc="Episodes that choose among the champions and prune them.",
    )
    test_episodes: int = episode_count(
        1000,
        because="the test is a mean over episodes",
        dear=200,
        doc="Unseen episodes of the final test.",
    )
    threads: int = setting(
        0,
        at_least=0,
        at_most=MOST_THREADS,
        because="it counts threads, of which more than there are cores gain nothing",
        doc="Threads of the kernel route; 0 takes all cores.",
    )
    steps_per_second: float | None = setting(
        None,
        above=0.0,
        doc="Environment steps a second from which budgets follow; null measures them at the start. The run's "
        "`config.yaml` holds what was used.",
    )
