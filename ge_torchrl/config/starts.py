"""The settings of dense starts."""

from dataclasses import dataclass
from typing import ClassVar

from ge_torchrl.checks import MOST_TREES
from ge_torchrl.config.setting import Section, setting


@dataclass(frozen=True)
class StartsConfig(Section):
    """Dense starts: trees of few splits over all features, raced against each other before evolution goes on from them.

    They are there where the grammar has sums, in splits or in leaves. Where it has none and steps are dear, trees of
    the grammar imitate the best of them, and their thresholds are moved to where they return most.
    """

    SECTION: ClassVar[str] = "starts"

    races: int = setting(
        2,
        at_least=0,
        because="it counts races; 0 leaves it to evolution",
        doc="Races, one a generation from the first on; the best trees of each are offered to the archive.",
    )
    count: int = setting(
        6,
        largest=MOST_TREES,
        at_least=1,
        because="somebody has to start",
        doc="Starts of a race. The better half goes on, then the best two, then the best one.",
    )
    max_timesteps: int | None = setting(
        None,
        at_least=1,
        because="a race is run by steps in the environment",
        doc="Environment steps of a race; null takes 3 million where steps are nearly free, and elsewhere so large a "
        "part of what the run may take that all races together have 0.6 of it. Imitating takes twice as many more.",
    )
    max_env_steps: int | None = setting(
        None,
        at_least=1,
        because="a run is more than its races",
        doc="Environment steps that a run with dense starts may take, on a machine of any speed, unless "
        "`ge.max_env_steps` is fewer or `ge.max_seconds` is given; null leaves it to these.",
    )
    rounding_episodes: int = setting(
        200,
        at_least=0,
        because="it counts episodes (0 rounds nothing)",
        doc="Episodes on which the best trees with sums are rounded at the end, to few terms and few digits, for as "
        "long as nothing is lost.",
    )
