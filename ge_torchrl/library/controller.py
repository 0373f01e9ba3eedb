"""A controller as a user of the library has it: it decides, shows itself, is saved, and is a policy of TorchRL."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ge_torchrl.artefacts.controllers import named_controller
from ge_torchrl.artefacts.texts import make_folder_of
from ge_torchrl.errors import InvalidObservationError
from ge_torchrl.printing import shortened
from ge_torchrl.report.tables import counted
from ge_torchrl.run.closing import drawn
from ge_torchrl.trees.controller import Controller as _Controller
from ge_torchrl.trees.files import write_controller
from ge_torchrl.trees.text import render_rules
from ge_torchrl.trees.tree import FloatArray

if TYPE_CHECKING:
    from tensordict.nn import TensorDictModule

# Floats, integers, unsigned ones, Booleans.
_NUMBERS = "fiub"


@dataclass(frozen=True, repr=False)
class Controller(_Controller):
    """A tree with its names: what decides, is saved, shown and played.

    >>> import ge_torchrl as ge
    >>> controller = ge.load("docs/trees/cartpole_two_decisions.json")
    >>> controller
    CartPole-v1, 2 decision nodes
    theta < -0.022 rad?
    ├─ yes: left
    └─ no:  x_dot < 0.49 m/s?
            ├─ yes: right
            └─ no:  left
    >>> action = controller([0.0, 0.1, 0.03, -0.3])  # the number of the action for one observation
    >>> controller.names.actions[action]
    'right'

    Attributes:
        tree: The tree.
        names: The environment and the names of its features and actions.
        provenance: Where the tree comes from: any JSON object.
    """

    @classmethod
    def of(cls, controller: _Controller) -> Controller:
        """Return the same controller as one of the library."""
        return cls(controller.tree, controller.names, controller.provenance)

    def __repr__(self) -> str:
        return f"{self.names.environment}, {counted(self.decision_nodes, 'decision node')}\n{drawn(self)}"

    def _repr_markdown_(self) -> str:
        return f"```text\n{self!r}\n```"

    def __call__(self, observation: ArrayLike) -> int | FloatArray:
        """Return the answer to one observation.

        Args:
            observation: [D], taken as float32.

        Returns:
            The number of the action, counted from 0; where leaves hold values, [A] float32, clipped to the bounds of
            the environment's actions.

        Raises:
            InvalidObservationError: It is something else than D numbers.
        """
        with suppress(TypeError, ValueError):
            # None would be taken for a number that nobody knows.
            if np.asarray(observation).dtype.kind in _NUMBERS:
                return super().__call__(observation)
        names = self.names
        raise InvalidObservationError(
            f"{names.id} is observed by {len(names.features)} features, so expected as many numbers "
            f"({shortened(', '.join(names.features))}); got {shortened(repr(observation))}{_of_reset(observation)}"
        )

    @property
    def decision_nodes(self) -> int:
        """Number of decision nodes."""
        return self.tree.num_decision_nodes

    def rules(self) -> str:
        """Return one rule a leaf.

        >>> import ge_torchrl as ge
        >>> print(ge.load("docs/trees/cartpole_two_decisions.json").rules())
        if theta < -0.022 rad then left
        if theta >= -0.022 rad and x_dot < 0.49 m/s then right
        if theta >= -0.022 rad and x_dot >= 0.49 m/s then left
        """
        return render_rules(self.tree, self.names)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the controller to a file of JSON, whole or not at all, and make its folder; `load` reads it.

        Raises:
            ArtefactError: The file cannot be written.
        """
        make_folder_of(Path(path))
        write_controller(path, self)

    def policy(self, *, categorical_action_encoding: bool = False) -> TensorDictModule:
        """Return the controller as a policy of TorchRL, which acts in `env.rollout` and in collectors.

        It reads `observation` and writes `action`: to the bit what the controller itself answers.

        Args:
            categorical_action_encoding: Whether an action is its number; otherwise it is one-hot. Say what the
                `GymEnv` was given, whose default this is too. Actions that are numbers are written as such.
        """
        from ge_torchrl.library.policy import policy_of

        return policy_of(self, one_hot=not categorical_action_encoding)


def _of_reset(observation: object) -> str:
    """Return what to say of what reset of an environment returns, if that is what came."""
    is_pair = isinstance(observation, tuple) and len(observation) == 2 and isinstance(observation[1], dict)
    return "; of what reset returns the first is the observation" if is_pair else ""


def load(path: str | os.PathLike[str], nodes: int | None = None) -> Controller:
    """Load a controller.

    Args:
        path: A tree's file, or a run's folder, whose champion is taken.
        nodes: Take the tree with so many decision nodes from the archive of the run; None takes the champion.

    Raises:
        ArtefactError: There is no such tree.
        InvalidTreeError: The file holds no tree.
    """
    return Controller.of(named_controller(Path(path), nodes, key="nodes"))
