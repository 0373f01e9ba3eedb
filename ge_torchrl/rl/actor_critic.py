"""Actor and critic as TorchRL's losses and collectors take them."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torch.distributions import Categorical
from torchrl.modules import MLP, ProbabilisticActor, ValueOperator

from ge_torchrl.rl.ddt import DDT


class ValueNetwork(nn.Module):
    """A ReLU network that may count features and values from their means, in units of their spreads.

    `V(s) = m_V + d_V f((s - m_s) / d_s)` with a network f whose inputs and outputs are then about 1. Without that a
    feature of a few hundredths is next to invisible to f, and a value of -100 takes more gradient steps than a
    refinement has.

    Args:
        n_features: Number of entries of an observation, D.
        hidden: Widths of the hidden layers.
    """

    feature_mean: Tensor
    feature_spread: Tensor
    value_mean: Tensor
    value_spread: Tensor

    def __init__(self, n_features: int, hidden: Sequence[int]) -> None:
        super().__init__()
        self.network = MLP(
            in_features=n_features, out_features=1, num_cells=list(hidden), activation_class=nn.ReLU
        )
        self.register_buffer("feature_mean", torch.zeros(n_features))
        self.register_buffer("feature_spread", torch.ones(n_features))
        self.register_buffer("value_mean", torch.zeros(1))
        self.register_buffer("value_spread", torch.ones(1))

    def forward(self, observation: Tensor) -> Tensor:
        """Return the values [..., 1] of observations [..., D]."""
        value: Tensor = self.network((observation - self.feature_mean) / self.feature_spread)
        return self.value_mean + self.value_spread * value

    def standardise_features(self, mean: Tensor, spread: Tensor) -> None:
        """Count features from `mean` [D] in units of `spread` [D], above 0."""
        self.feature_mean.copy_(mean)
        self.feature_spread.copy_(spread)

    def standardise_values(self, mean: Tensor, spread: Tensor) -> None:
        """Count values from `mean` [1] in units of `spread` [1], above 0."""
        self.value_mean.copy_(mean)
        self.value_spread.copy_(spread)


def make_actor_critic(
    ddt: DDT, n_features: int, hidden: Sequence[int] = (64, 64), *, generator: torch.Generator
) -> tuple[ProbabilisticActor, ValueOperator]:
    """Build the actor around a DDT and a ReLU network as its critic.

    The actor reads `observation` and writes `logits`, `action` (int64) and `action_log_prob`; the critic reads
    `observation` and writes `state_value` [..., 1].

    Args:
        ddt: The tree; the actor shares its parameters.
        n_features: Number of entries of an observation, D.
        hidden: Widths of the critic's hidden layers.
        generator: Draws the critic's first weights.

    Returns:
        The actor and the critic.
    """
    actor = ProbabilisticActor(
        TensorDictModule(ddt, in_keys=["observation"], out_keys=["logits"]),
        in_keys=["logits"],
        out_keys=["action"],
        distribution_class=Categorical,
        # The arguments are finite by construction, and checking them costs as much as the forward pass.
        distribution_kwargs={"validate_args": False},
        return_log_prob=True,
    )
    return actor, ValueOperator(_make_network(n_features, hidden, generator), in_keys=["observation"])


def ddt_of(actor: ProbabilisticActor) -> DDT:
    """Return the tree inside an actor."""
    return next(module for module in actor.modules() if isinstance(module, DDT))


def value_network_of(critic: ValueOperator) -> ValueNetwork:
    """Return the network inside a critic."""
    return next(module for module in critic.modules() if isinstance(module, ValueNetwork))


def _make_network(n_features: int, hidden: Sequence[int], generator: torch.Generator) -> ValueNetwork:
    """Make the critic's network; torch's layers draw from the global stream, which is lent and given back."""
    seed = int(torch.randint(2**62, (), generator=generator))
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return ValueNetwork(n_features, hidden)
