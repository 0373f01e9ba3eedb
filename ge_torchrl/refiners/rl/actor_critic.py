"""Actor and critic as TorchRL's losses and collectors take them, for many trees at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final, Protocol, TypeAlias

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torch.distributions import Categorical, Distribution
from torchrl.modules import ProbabilisticActor

from ge_torchrl.refiners.rl.ddt import DDT, columns_of

_Shape: TypeAlias = torch.Size | list[int] | tuple[int, ...]
_ONE: Final = torch.Size()


class ValueNetworks(nn.Module):
    """`R` independent ReLU networks, which count features and values from their means, in units of their spreads.

    `V(s) = m_V + d_V f((s - m_s) / d_s)` with a network f whose inputs and outputs are then about 1. Without that a
    feature of a few hundredths is next to invisible to f, and a value of -100 takes more gradient steps than a
    refinement has.

    Args:
        n_features: Number of entries of an observation, D.
        hidden: Widths of the hidden layers.
        generators: [R], each draws the first weights of its network, as `torch.nn.Linear` does.

    Attributes:
        numbers: [R, N] float32 parameter, weights and biases of all layers in their order: one tensor is quickly
            stepped and checked.
        feature_mean: [R, D, 1] buffer, 0 unless standardised.
        feature_spread: [R, D, 1] buffer, 1 unless standardised.
        value_mean: [R, 1, 1] buffer, 0 unless standardised.
        value_spread: [R, 1, 1] buffer, 1 unless standardised.
    """

    feature_mean: Tensor
    feature_spread: Tensor
    value_mean: Tensor
    value_spread: Tensor

    def __init__(self, n_features: int, hidden: Sequence[int], generators: Sequence[torch.Generator]) -> None:
        super().__init__()
        # The shapes of weights [H_i, H_(i-1)] and biases [H_i, 1].
        self._shapes = [shape for n, m in pairwise([n_features, *hidden, 1]) for shape in ((m, n), (m, 1))]
        self.numbers = nn.Parameter(torch.stack([_first_numbers(self._shapes, own) for own in generators]))
        n_trees = len(generators)
        self.register_buffer("feature_mean", torch.zeros(n_trees, n_features, 1))
        self.register_buffer("feature_spread", torch.ones(n_trees, n_features, 1))
        self.register_buffer("value_mean", torch.zeros(n_trees, 1, 1))
        self.register_buffer("value_spread", torch.ones(n_trees, 1, 1))

    def forward(self, observation: Tensor) -> Tensor:
        """Return the values [*S, 1] of observations [*S, D], whose rows are `R` equal runs."""
        columns = columns_of(observation, len(self.value_mean), self.value_mean.dtype)
        columns = (columns - self.feature_mean) / self.feature_spread
        for i, (weight, bias) in enumerate(self.layers()):
            columns = torch.baddbmm(bias, weight, columns if i == 0 else columns.relu_())
        value: Tensor = self.value_mean + self.value_spread * columns
        return value.reshape(*observation.shape[:-1], 1)

    def layers(self) -> list[tuple[Tensor, Tensor]]:
        """Return the weights [R, H_i, H_(i-1)] and biases [R, H_i, 1] of each layer."""
        parts = torch.split(self.numbers, [m * n for m, n in self._shapes], 1)
        tensors = [part.view(-1, *shape) for part, shape in zip(parts, self._shapes, strict=True)]
        return list(zip(tensors[::2], tensors[1::2], strict=True))

    def standardise_features(self, mean: Tensor, spread: Tensor) -> None:
        """Count features from `mean` [R, D] in units of `spread` [R, D], above 0."""
        self.feature_mean.copy_(mean.unsqueeze(-1))
        self.feature_spread.copy_(spread.unsqueeze(-1))

    def standardise_values(self, mean: Tensor, spread: Tensor) -> None:
        """Count values from `mean` [R] in units of `spread` [R], above 0."""
        self.value_mean.copy_(mean.view(-1, 1, 1))
        self.value_spread.copy_(spread.view(-1, 1, 1))


class DirectModule(TensorDictModule):  # type: ignore[misc]
    """A `TensorDictModule` of one input and one output, which asks of neither whether it might be something else.

    That takes a tenth of a gradient step of one tree.
    """

    def forward(self, tensordict: TensorDictBase, **_: Any) -> TensorDictBase:
        """Write the output to the samples."""
        tensordict.set(self.out_keys[0], self.module(tensordict.get(self.in_keys[0])))
        return tensordict


class Draws(Protocol):
    """Gives uniform numbers that decide actions."""

    def next(self) -> Tensor:
        """Return numbers in [0, 1), one for each action."""
        ...


class LogCategorical(Categorical):
    """A categorical distribution of log-probabilities: they are taken as they are, not normalised once more.

    Args:
        logits: [*S, A] log-probabilities, finite.
        draws: Gives the uniform numbers [*S] that decide samples; None leaves them to torch.
    """

    def __init__(self, logits: Tensor, draws: Draws | None = None) -> None:
        self._draws = draws
        self.logits = self._param = logits
        self._num_events = logits.shape[-1]
        Distribution.__init__(self, logits.shape[:-1], validate_args=False)

    @property
    def probs(self) -> Tensor:
        """[*S, A] probabilities."""
        return self.logits.exp()

    @property
    def deterministic_sample(self) -> Tensor:
        """[*S] the most probable actions, for TorchRL."""
        return self.mode

    def sample(self, sample_shape: _Shape = _ONE) -> Tensor:
        """Return actions [*S]."""
        if self._draws is None:
            drawn: Tensor = super().sample(sample_shape)  # type: ignore[no-untyped-call]
            return drawn
        passed = self.probs.cumsum(-1) <= self._draws.next().unsqueeze(-1)
        # What rounding leaves of a sum of one falls to the last action.
        return passed.sum(-1).clamp_max(self._num_events - 1)

    def entropy(self) -> Tensor:
        """Return the entropy [*S], in nats."""
        return -(self.logits.exp() * self.logits).sum(-1)


def make_actor(ddt: DDT, draws: Draws | None = None) -> ProbabilisticActor:
    """Build the actor around soft trees; it shares their parameters.

    It reads `observation` and writes `logits`, `action` (int64) and `action_log_prob`.

    Args:
        ddt: The trees.
        draws: As of `LogCategorical`.
    """
    return ProbabilisticActor(
        DirectModule(ddt, in_keys=["observation"], out_keys=["logits"]),
        in_keys=["logits"],
        out_keys=["action"],
        distribution_class=LogCategorical,
        distribution_kwargs={"draws": draws},
        return_log_prob=True,
    )


def make_critic(networks: ValueNetworks) -> TensorDictModule:
    """Build the critic, which reads `observation` and writes `state_value` [*S, 1]."""
    return DirectModule(networks, in_keys=["observation"], out_keys=["state_value"])


def _first_numbers(shapes: Sequence[tuple[int, int]], generator: torch.Generator) -> Tensor:
    """Draw the numbers [N] of one network: those of a layer with n inputs are uniform within 1 / sqrt(n)."""
    numbers = []
    for (n_out, n_in), bias in zip(shapes[::2], shapes[1::2], strict=True):
        bound = 1 / math.sqrt(n_in)
        n_numbers = n_out * n_in + math.prod(bias)
        numbers.append(torch.empty(n_numbers).uniform_(-bound, bound, generator=generator))
    return torch.cat(numbers)
