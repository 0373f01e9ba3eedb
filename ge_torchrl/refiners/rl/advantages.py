"""Generalised advantage estimation (Schulman et al., 2016) of many streams at once."""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.objectives.value import GAE


class ScanGAE(GAE):  # type: ignore[misc]
    """TorchRL's `GAE` with its recursion by doubling: log2(T) operations on all samples where that has T on a few.

    It adds `advantage` and `value_target` [*S, T, 1] to samples [*S, T]:
    `A_t = delta_t + gamma lambda (1 - done_t) A_(t+1)` with
    `delta_t = r_t + gamma (1 - terminated_t) V(s'_t) - V(s_t)`. A truncated episode goes on beyond its last step as far
    as its value is concerned, a terminated one does not.
    """

    @torch.no_grad()
    def forward(self, tensordict: TensorDictBase, **_: Any) -> TensorDictBase:
        """Add advantages and targets to samples [*S, T]; the last dimension is time."""
        after = tensordict["next"]
        value = self.value_network(tensordict)["state_value"].squeeze(-1)
        next_value = self.value_network(after.select("observation"))["state_value"].squeeze(-1)
        reward, terminated, done = (after[key].squeeze(-1) for key in ("reward", "terminated", "done"))
        delta = reward + self.gamma * next_value * ~terminated - value
        advantage = _discounted_sums(delta, self.gamma * self.lmbda * ~done)
        tensordict["advantage"] = advantage.unsqueeze(-1)
        tensordict["value_target"] = (advantage + value).unsqueeze(-1)
        return tensordict


def _discounted_sums(terms: Tensor, discounts: Tensor) -> Tensor:
    """Return [*S, T], `A_t = terms_t + discounts_t A_(t+1)`.

    After the step of length k, A_t holds the terms t to t + 2k - 1, and a discount what leads from t to t + 2k.
    """
    sums = terms.clone()
    length = 1
    while length < terms.shape[-1]:
        sums[..., :-length] += discounts[..., : terms.shape[-1] - length] * sums[..., length:]
        discounts = discounts[..., :-length] * discounts[..., length:]
        length *= 2
    return sums
