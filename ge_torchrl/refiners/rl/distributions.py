"""What soft trees draw: actions, or values from a mixture of normal distributions, one for each leaf."""

from __future__ import annotations

import math
from typing import Protocol, TypeAlias

import torch
from torch import Tensor
from torch.distributions import Categorical, Distribution

_Shape: TypeAlias = torch.Size | list[int] | tuple[int, ...]
_ONE = torch.Size()
_LOG_OF_ROOT_2_PI = 0.5 * math.log(2 * math.pi)
# So many deviations away a density is 0 in any precision; its square is a float32.
_FARTHEST = 1e9
# A leaf whose density is more than e^30 times that of the mixture has next to no weight, or none.
_LARGEST_LOG_RATIO = 30.0
_LEAST = 1e-38


class Draws(Protocol):
    """Gives numbers that decide actions."""

    def next(self) -> Tensor:
        """Return numbers in [0, 1), one for each action."""
        ...

    def normal(self) -> Tensor:
        """Return standard normal numbers, one for each value of an action that is no choice."""
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


class GaussianMixture(Distribution):
    """`sum_l w_l Normal(answer_l, sd)`, each value by itself within a leaf.

    `torch.distributions.MixtureSameFamily` says the same of positive weights, at several times the cost. Here a weight
    may be 0 and still have a gradient: so that hard paths can decide, and soft ones learn.

    Args:
        leaf_weights: [*S, L], at or above 0, of sum one.
        answers: [*S, L, A].
        log_sd: [*S, A], for all leaves.
        draws: Gives the numbers that decide samples; None leaves them to torch.
    """

    def __init__(
        self, leaf_weights: Tensor, answers: Tensor, log_sd: Tensor, draws: Draws | None = None
    ) -> None:
        self._weights, self._answers, self._log_sd, self._draws = leaf_weights, answers, log_sd, draws
        super().__init__(leaf_weights.shape[:-1], answers.shape[-1:], validate_args=False)

    @property
    def deterministic_sample(self) -> Tensor:
        """[*S, A] the answers of the leaves of most weight, for TorchRL."""
        return self._answers_of(self._weights.argmax(-1))

    @property
    def mode(self) -> Tensor:
        """[*S, A] the same."""
        return self.deterministic_sample

    @torch.no_grad()
    def sample(self, sample_shape: _Shape = _ONE) -> Tensor:  # noqa: ARG002
        """Return values [*S, A]: a leaf is drawn, and then its values."""
        if self._draws is None:
            uniform, normal = torch.rand(self._weights.shape[:-1]), torch.randn(self._log_sd.shape)
        else:
            uniform, normal = self._draws.next(), self._draws.normal()
        # What rounding leaves of a sum of one falls to the last leaf that has any weight.
        cumulated = self._weights.cumsum(-1)
        passed = cumulated <= (uniform.unsqueeze(-1) * cumulated[..., -1:])
        leaf = passed.sum(-1).clamp_max(self._weights.shape[-1] - 1)
        return self._answers_of(leaf) + self._log_sd.exp() * normal

    def log_prob(self, value: Tensor) -> Tensor:
        """Return the logarithm [*S] of the density at values [*S, A]."""
        distance = (value.unsqueeze(-2) - self._answers) * (-self._log_sd).exp().unsqueeze(-2)
        squares = distance.clamp(-_FARTHEST, _FARTHEST).square().sum(-1)
        of_leaf = -0.5 * squares - (self._log_sd + _LOG_OF_ROOT_2_PI).sum(-1, keepdim=True)
        # Counted from the largest part, so that nothing is lost far away from all answers.
        with torch.no_grad():
            largest = (of_leaf + self._weights.clamp_min(_LEAST).log()).amax(-1, keepdim=True)
        ratios = (of_leaf - largest).clamp_max(_LARGEST_LOG_RATIO).exp()
        return (self._weights * ratios).sum(-1).clamp_min(_LEAST).log() + largest.squeeze(-1)

    def entropy(self) -> Tensor:
        """Return a lower bound [*S] of the entropy, in nats: that of the values once the leaf is known.

        A mixture's own entropy has no closed form. What the bound leaves out, which leaf is drawn, is at most the
        logarithm of their number.
        """
        return (self._log_sd + _LOG_OF_ROOT_2_PI + 0.5).sum(-1)

    def _answers_of(self, leaf: Tensor) -> Tensor:
        index = leaf[..., None, None].expand(*leaf.shape, 1, self._answers.shape[-1])
        return self._answers.gather(-2, index).squeeze(-2)
