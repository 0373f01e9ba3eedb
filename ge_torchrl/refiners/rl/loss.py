"""The clipped objective of PPO (Schulman et al., 2017) of many trees at once."""

from __future__ import annotations

import math
from typing import Any, Final

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule
from torchrl.modules import ProbabilisticActor
from torchrl.objectives import ClipPPOLoss

# The usual weight of the critic's error. Actor and critic share no parameter and have learning rates of their own, so
# another weight would do next to nothing.
_CRITIC_COEFF: Final = 0.5


class TreesPPOLoss(ClipPPOLoss):  # type: ignore[misc]
    """TorchRL's `ClipPPOLoss` of trees [R, T], each with its own advantages' mean and spread, not reduced.

    It gives the same `loss_objective`, `loss_critic` and `loss_entropy` [R, T] to the bit, and none of the statistics
    that TorchRL adds to them at every step: those took a fifth of it and are averages over all trees.

    Args:
        actor: The actor of `R` trees.
        critic: Their critics.
        clip_epsilon: How far from 1 the ratio of probabilities still pays.
        entropy_coeff: Weight of the entropy bonus; a buffer that may be changed.
    """

    def __init__(
        self,
        actor: ProbabilisticActor,
        critic: TensorDictModule,
        clip_epsilon: float,
        entropy_coeff: float,
    ) -> None:
        super().__init__(
            actor,
            critic,
            clip_epsilon=clip_epsilon,
            entropy_coeff=entropy_coeff,
            critic_coeff=_CRITIC_COEFF,
            loss_critic_type="l2",
            normalize_advantage=True,
            normalize_advantage_exclude_dims=(0,),
            reduction="none",
            functional=False,
        )
        lowest = math.log1p(-clip_epsilon) if clip_epsilon < 1 else -math.inf
        self._bounds = lowest, math.log1p(clip_epsilon)

    def forward(self, tensordict: TensorDictBase, **_: Any) -> TensorDict:
        """Return the losses [R, T] of samples with `advantage` and `value_target`."""
        advantage = tensordict.get("advantage").squeeze(-1)
        mean, spread = advantage.mean(1, keepdim=True), advantage.std(1, keepdim=True)
        advantage = (advantage - mean) / spread.clamp_min(torch.finfo(spread.dtype).resolution)
        seen = tensordict.select("observation")
        policy = self.actor_network.get_dist(seen)
        log_ratio = policy.log_prob(tensordict.get("action")) - tensordict.get("action_log_prob")
        clipped = log_ratio.clamp(*self._bounds)
        gain = torch.minimum(log_ratio.exp() * advantage, clipped.exp() * advantage)
        value = self.critic_network(seen).get("state_value")
        error = (value - tensordict.get("value_target")).squeeze(-1).square()
        return TensorDict(
            {
                "loss_objective": -gain,
                "loss_critic": _CRITIC_COEFF * error,
                "loss_entropy": -self.entropy_coeff * policy.entropy(),
            },
            tensordict.batch_size,
        )
