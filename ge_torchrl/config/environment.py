"""The settings of the environment."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from ge_torchrl.checks import UNSET
from ge_torchrl.config.setting import Section, mapping, setting

MOST_THREADS = 1024
"""Threads and processes: as many as the largest machines have cores."""


@dataclass(frozen=True)
class EnvironmentConfig(Section):
    """Which environment, what its numbers are called, and how its episodes are run."""

    SECTION: ClassVar[str] = "env"

    id: str = setting(
        doc="Gymnasium id; one that a file of `conf/env` names takes that file.",
        text="a Gymnasium id such as CartPole-v1",
    )
    dynamics: str | None = setting(
        None,
        doc="Dynamics of your own, which are the `env.id` too: a file and a class in it, such as `plant.py:Cart`; see "
        "[your own plant](your_own_plant.md).",
        text="a file and a class in it, such as plant.py:Cart",
    )
    kwargs: Mapping[str, Any] = mapping(
        example="{gravity: -5}",
        doc="What else the environment is made with, such as `env.kwargs.gravity=-5`; of dynamics of your own, "
        "numbers of their file, such as `env.kwargs.LENGTH=0.4`.",
    )
    wrappers: tuple[str, ...] = setting(
        (),
        doc="Wrappers around it, innermost first, each `module:Class`, or `module:Class {key: value}` with arguments.",
    )
    features: tuple[str, ...] = setting(
        (),
        distinct=True,
        because="a tree is read by them",
        doc="Names of the observation's entries; empty means `x0`, `x1`, ...",
    )
    units: tuple[str, ...] = setting(
        (), doc="Their units, an empty text where there is none; empty means none at all."
    )
    actions: tuple[str, ...] = setting(
        (),
        distinct=True,
        because="a tree is read by them",
        doc="Names of the actions, or of the entries of a continuous one; empty means `a0`, `a1`, ..., or its values "
        "where a continuous action is cut into bins, such as `action_minus_1_6`",
    )
    symmetry: Mapping[str, Any] | None = mapping(
        example="{negate: [x], actions: {left: right}}",
        doc="The mirror of the environment, where it has one: `negate`, the features that change their sign in it; "
        "`swap`, pairs of features that change places; `actions`, pairs of actions that do; `negate_actions`, entries "
        "of a continuous action that change their sign. Where nothing is said, it is what the class of "
        "dynamics of your own declares; null does without.",
    )
    solved_at: float | None = setting(None, doc="Mean return from which the task counts as solved.")
    lowest_return: float | None = setting(
        None, doc="The lowest return possible: a tree whose fitness it is learns nothing and is not refined."
    )
    max_episode_steps: int | None = setting(
        None,
        at_least=1,
        because="an episode has at least one step",
        doc="Limit of an episode's length; null takes the environment's own, and where there is none, one by what "
        "random policies do.",
    )
    step_seconds: float = setting(
        300.0,
        above=0,
        doc="A step or a reset by Gymnasium that takes longer is taken to hang, which ends the run [s].",
    )
    route: str = setting(
        "auto",
        choices=("auto", "kernel", "gymnasium"),
        renamed=(("compiled", "kernel"),),
        doc="What steps the environment: a compiled `kernel`, `gymnasium`, or `auto`: the kernel where there is one.",
    )
    workers: int = setting(
        0,
        at_least=0,
        at_most=MOST_THREADS,
        because="it counts processes, of which more than there are cores gain nothing",
        doc="Worker processes of the Gymnasium route; 0 decides by itself.",
    )

    def __post_init__(self) -> None:
        if isinstance(self.dynamics, str) and not self.dynamics.strip():
            # It would be told of the id else, which nobody typed.
            self.refuse("dynamics", "a file and a class in it, such as plant.py:Cart or null")
        if self.id == UNSET and isinstance(self.dynamics, str):
            object.__setattr__(self, "id", self.dynamics)
        super().__post_init__()

    def check_together(self) -> None:
        """Refuse an environment that is named twice."""
        if self.dynamics is not None and self.id != self.dynamics:
            self.refuse(
                "dynamics",
                "null beside another env.id",
                f"one of both makes the environment, and env.id={self.id}",
            )
