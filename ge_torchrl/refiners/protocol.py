"""What a refiner is, whatever its method: trees in, better parameters out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from ge_torchrl.trees.tree import DecisionTree


@dataclass(frozen=True)
class Effort:
    """How much more, or less, than in a first refinement is spent on a tree.

    Attributes:
        factor: How many times the method's episodes, and its environment steps.
        patience: How many times the steps beyond that, so that so many times more trees can be tried.
        step: How many times the first step of parameters, where a method has one: a tree that is good already is
            searched nearer by.
    """

    factor: float = 1
    patience: float = 1
    step: float = 1.0


FIRST: Final = Effort()
"""The effort of a first refinement."""


@dataclass(frozen=True)
class TrainingRecord:
    """What a refinement took; losses and their companions are those of the last gradient step, NaN before the first.

    Attributes:
        timesteps: Environment steps that this tree took; the backend has counted them, under the refiner's purpose.
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


@dataclass(frozen=True, eq=False)
class Refined:
    """What a refiner made of a tree.

    Attributes:
        tree: The tree, its structure but for actions of leaves unchanged; as it was if training failed.
        training: What it took; None where a limit left no room to begin.
    """

    tree: DecisionTree
    training: TrainingRecord | None


class Refiner(Protocol):
    """Makes better trees of trees; its environment steps are counted by the backend, under the refiner's purpose."""

    def refine(
        self,
        trees: Sequence[DecisionTree],
        rngs: Sequence[np.random.Generator],
        effort: Effort = FIRST,
    ) -> list[Refined]:
        """Refine trees side by side, each as if it were alone.

        Args:
            trees: [R] trees.
            rngs: [R] a stream of randomness for each.
            effort: How much more than in a first refinement.

        Returns:
            [R] what became of each.

        Raises:
            LimitReachedError: The backend's limit was reached first.
        """
        ...
