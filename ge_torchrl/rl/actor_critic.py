"""Actor and critic as TorchRL's losses and collectors take them."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from tensordict.nn import TensorDictModule
from torch.distributions import Categorical
from torchrl.modules import MLP, ProbabilisticActor, ValueOperator

from ge_torchrl.rl.ddt import DDT


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


def _make_network(n_features: int, hidden: Sequence[int], generator: torch.Generator) -> MLP:
    """Make the critic's network; torch's layers draw from the global stream, which is lent and given back."""
    seed = int(torch.randint(2**62, (), generator=generator))
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return MLP(
            in_features=n_features, out_features=1, num_cells=list(hidden), activation_class=torch.nn.ReLU
        )
