"""The settings of the archive: the best trees of each number of decision nodes."""

from dataclasses import dataclass
from typing import ClassVar

from ge_torchrl.checks import MOST_TREES
from ge_torchrl.config.setting import Section, episode_count, setting


@dataclass(frozen=True)
class ArchiveConfig(Section):
    """The best trees of each number of decision nodes: how they are kept, and how the search goes on from them.

    Where nothing is kept, or nothing refines trees, nothing goes on from them, whatever is asked for.
    """

    SECTION: ClassVar[str] = "archive"

    keep: int = setting(
        8,
        largest=MOST_TREES,
        at_least=0,
        because="it counts trees; 0 keeps no archive",
        dear=3,
        doc="Trees of each number of decision nodes that are kept until validation chooses, each of another structure; "
        "0: no archive.",
    )
    episodes: int = episode_count(
        1000,
        because="trees are kept by a mean over episodes",
        dear=50,
        doc="Episodes of its own that measure what is offered.",
    )
    max_nodes: int = setting(
        8, at_least=0, because="a lone leaf has no decision node", doc="Decision nodes of the largest trees."
    )
    neighbours: int = setting(
        26,
        largest=MOST_TREES,
        at_least=0,
        because="it counts trees",
        dear=0,
        doc="Trees one or two edits away from kept ones that are proposed in a scheduled generation.",
    )
    neighbours_drawn: int = setting(
        500,
        largest=MOST_TREES,
        at_least=1,
        because="neighbours are chosen among those drawn",
        dear=40,
        doc="Neighbours drawn and measured on the training episodes, from which they are chosen.",
    )
    races: int = setting(
        0,
        at_least=0,
        because="it counts races; 0 runs none",
        dear=8,
        doc="Races in a generation: neighbours of a kept tree run against it on common episodes, in growing rounds; "
        "one that is better by three standard errors takes its place, and the next race is against that one. A tree "
        "that nothing beats any more is challenged from another start. 0: none.",
    )
    raced: int = setting(
        24,
        largest=MOST_TREES,
        at_least=1,
        because="somebody has to run",
        doc="Neighbours in a race.",
    )
    short_list: int = setting(
        0,
        largest=MOST_TREES,
        at_least=0,
        because="it counts trees; 0 makes no short list",
        doc="Neighbours, and crossings of two kept trees, that get a short polish first; those that come nearest to "
        "the kept trees of their size are proposed. 0: neighbours are proposed as they are drawn.",
    )
    revisit_factor: int = setting(
        5,
        at_least=0,
        because="it multiplies a budget; 0 refines no kept tree again",
        dear=2,
        doc="How many times the episodes and steps the kept tree takes that is refined again in a scheduled "
        "generation; 0: none.",
    )
    migrants: int = setting(
        20,
        largest=MOST_TREES,
        at_least=0,
        because="it counts individuals",
        dear=10,
        doc="Kept trees that take the places of the least fit individuals after a scheduled generation.",
    )
    final_keep: int = setting(
        8,
        largest=MOST_TREES,
        at_least=0,
        because="it counts trees",
        dear=0,
        doc="Kept trees of each number of decision nodes that are refined once more after evolution; 0: none.",
    )
    final_factor: int = setting(
        20,
        at_least=1,
        because="it multiplies a budget",
        dear=5,
        doc="How many times the episodes and steps this takes.",
    )
    final_patience: int = setting(
        1,
        at_least=1,
        because="it multiplies a budget",
        doc="How many times the steps, but not the episodes, beyond that.",
    )
    final_step: float = setting(
        1.0, above=0.0, doc="How many times the first step, where the method has one."
    )

    @property
    def enabled(self) -> bool:
        """Whether there is an archive."""
        return self.keep != 0
