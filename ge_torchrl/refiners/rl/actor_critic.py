"""Actor and critic as TorchRL's losses and collectors take them, for many trees at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, TypeAlias

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.modules import ProbabilisticActor

from ge_torchrl.refiners.rl.ddt import DDT
from ge_torchrl.refiners.rl.distributions import Draws, GaussianMixture, LogCategorical
from ge_torchrl.refiners.rl.gaussian import GaussianDDT
from ge_torchrl.refiners.rl.splits import columns_of

SoftTrees: TypeAlias = DDT | GaussianDDT
"""Soft trees of either kind of leaves."""


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
    """A `TensorDictModule` of one input, which asks of neither it nor its outputs whether they might be something else.

    That takes a tenth of a gradient step of one tree.
    """

    def forward(self, tensordict: TensorDictBase, **_: Any) -> TensorDictBase:
        """Write the output, or the outputs, to the samples."""
        outputs = self.module(tensordict.get(self.in_keys[0]))
        for key, output in zip(self.out_keys, outputs if len(self.out_keys) > 1 else (outputs,), strict=True):
            tensordict.set(key, output)
        return tensordict


def make_actor(ddt: SoftTrees, draws: Draws | None = None) -> ProbabilisticActor:
    """Build the actor around soft trees; it shares their parameters.

    It reads `observation` and writes the parameters of its distribution, `action` (int64; float32 values) and
    `action_log_prob`.

    Args:
        ddt: The trees.
        draws: As of `LogCategorical` and `GaussianMixture`.
    """
    is_gaussian = isinstance(ddt, GaussianDDT)
    keys = ["leaf_weights", "answers", "log_sd"] if is_gaussian else ["logits"]
    return ProbabilisticActor(
        DirectModule(ddt, in_keys=["observation"], out_keys=keys),
        in_keys=keys,
        out_keys=["action"],
        distribution_class=GaussianMixture if is_gaussian else LogCategorical,
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
