"""A controller as a TensorDictModule, for whatever TorchRL runs policies in."""

from __future__ import annotations

import numpy as np
import torch
from tensordict.nn import TensorDictModule

from ge_torchrl.errors import InvalidObservationError
from ge_torchrl.trees.controller import Controller


def policy_of(controller: Controller, *, one_hot: bool) -> TensorDictModule:
    """Return the policy that answers as a controller does.

    Args:
        controller: What decides.
        one_hot: Whether an action that is one of a few is written one-hot, and not as its number.

    Returns:
        A module that reads `observation` [..., D] and writes `action`: [...] int64, or [..., A] one-hot int64, or
        [..., A] float32 values, on the device of the observation.
    """
    return TensorDictModule(
        _Decides(controller, one_hot=one_hot), in_keys=["observation"], out_keys=["action"]
    )


class _Decides(torch.nn.Module):
    """The controller's own decision, by NumPy: a comparison in torch would be another one to keep to the bit."""

    def __init__(self, controller: Controller, *, one_hot: bool) -> None:
        super().__init__()
        self._controller, self._one_hot = controller, one_hot

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return the actions for observations [..., D]."""
        n_features, n_actions = len(self._controller.names.features), len(self._controller.names.actions)
        if observation.shape[-1] != n_features:
            raise InvalidObservationError(
                f"{self._controller.names.id} is observed by {n_features} features; "
                f"these observations have shape {list(observation.shape)}"
            )
        rows = observation.detach().cpu().numpy().astype(np.float32).reshape(-1, n_features)
        actions = torch.from_numpy(self._controller.decide(rows)).to(observation.device)
        if not self._controller.tree.has_actions:
            return actions.reshape(*observation.shape[:-1], n_actions)
        actions = actions.long().reshape(observation.shape[:-1])
        return torch.nn.functional.one_hot(actions, n_actions) if self._one_hot else actions
