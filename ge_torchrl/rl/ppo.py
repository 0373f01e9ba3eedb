"""Proximal policy optimisation (PPO) of a differentiable tree, in TorchRL.

Source: Schulman et al., "Proximal policy optimization algorithms" (2017), with generalised advantage estimation
(Schulman et al., 2016); the settings of the thesis "Backpropagation-based reinforcement learning for decision trees",
Table A.1, including RMSprop and full-batch steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import torch
from tensordict import TensorDict
from torch import Tensor
from torch.nn.utils import get_total_norm
from torchrl.modules import ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from ge_torchrl.records import TrainingRecord
from ge_torchrl.rl.actor_critic import make_actor_critic, value_network_of
from ge_torchrl.rl.ddt import DDT
from ge_torchrl.rl.samples import Source, finished_returns

_OPTIMIZERS = {"rmsprop": torch.optim.RMSprop, "adam": torch.optim.Adam}
_BATCH_KEYS = ("observation", "action", "action_log_prob", "advantage", "value_target")


@dataclass(frozen=True)
class PPOSettings:
    """Settings of one training, Table A.1 of the thesis by default where it names one value for all environments.

    Attributes:
        max_timesteps: Environment steps of the training; what does not fill an update is not taken.
        update_timesteps: Environment steps of one update, T.
        epochs: Passes over the samples of one update; each is one gradient step unless there are minibatches.
        clip_epsilon: How far from 1 the ratio of probabilities still pays.
        gamma: Discount.
        gae_lambda: Decay of the generalised advantage estimate.
        lr_actor: Learning rate of the tree.
        lr_critic: Learning rate of the critic.
        entropy_coeff: Weight of the entropy bonus.
        critic_coeff: Weight of the critic's squared error.
        hidden: Widths of the critic's hidden layers.
        scale_features: Whether thresholds are counted in units of their features' standard deviation over a first
            batch of samples, which is spent on that alone.
        scale_critic: Whether the critic counts features and values in units of their spreads over that batch.
        alpha_final: Steepness of the decisions in the last update, reached geometrically; None leaves it.
        lr_thresholds: Learning rate of the thresholds; None takes that of the tree.
        optimizer: "rmsprop" or "adam".
        minibatch_size: Samples of a gradient step, all of an update's being used in every epoch; None takes all at
            once.
        entropy_final: Weight of the entropy bonus in the last update, reached linearly; None leaves it.
    """

    max_timesteps: int
    update_timesteps: int
    epochs: int
    clip_epsilon: float = 0.2
    gamma: float = 0.95
    gae_lambda: float = 0.95
    lr_actor: float = 0.001
    lr_critic: float = 0.001
    entropy_coeff: float = 0.01
    critic_coeff: float = 0.5
    hidden: tuple[int, ...] = (64, 64)
    scale_features: bool = False
    scale_critic: bool = False
    alpha_final: float | None = None
    lr_thresholds: float | None = None
    optimizer: str = "rmsprop"
    minibatch_size: int | None = None
    entropy_final: float | None = None


def train(
    ddt: DDT,
    source: Source,
    settings: PPOSettings,
    seed: int,
    after_update: Callable[[], None] = lambda: None,
) -> TrainingRecord:
    """Train a tree's thresholds and leaves in place.

    Training stops at the first loss, gradient or parameter that is not finite; the tree is then put back to what it
    was. The critic is made anew for each training, from `seed`; the samples' randomness is the source's own. The
    result does not depend on how many threads torch is set to: training uses one.

    Args:
        ddt: The tree, trained in place.
        source: Where samples come from; the caller closes it.
        settings: The settings.
        seed: Seed of the critic's first weights.
        after_update: Called after each update that went well, to look at the tree as it then is.

    Returns:
        What was done, and how it ended.
    """
    generator = torch.Generator().manual_seed(seed)
    actor, critic = make_actor_critic(ddt, source.spec.n_features, settings.hidden, generator=generator)
    learner = _Learner(ddt, actor, critic, settings, generator)
    before = {name: value.clone() for name, value in ddt.state_dict().items()}
    record = TrainingRecord()
    with _one_thread():
        n_updates = settings.max_timesteps // settings.update_timesteps
        if (settings.scale_features or settings.scale_critic) and n_updates > 0:
            samples = source.collect(actor, settings.update_timesteps)
            if settings.scale_features:
                ddt.standardise(_spread(samples["observation"]))
            if settings.scale_critic:
                learner.standardise_critic(samples)
            record, n_updates = TrainingRecord(timesteps=len(samples)), n_updates - 1
        alpha = ddt.alpha
        for update in range(n_updates):
            progress = update / max(n_updates - 1, 1)
            if settings.alpha_final is not None:
                ddt.alpha = alpha * (settings.alpha_final / alpha) ** progress
            learner.set_entropy_coeff(progress)
            samples = source.collect(actor, settings.update_timesteps)
            record = learner.update(samples, record)
            if record.failure is not None:
                ddt.load_state_dict(before)
                break
            after_update()
    return record


def _spread(samples: Tensor) -> Tensor:
    """Return [D], the standard deviation of each column of samples [T, D]; 1 where it tells nothing."""
    spread = samples.double().std(0)
    # A feature that never moved has no scale of its own, and neither has one that is not a number.
    return torch.where(spread.isfinite() & (spread > 0), spread, 1.0).float()


@contextmanager
def _one_thread() -> Iterator[None]:
    # A second thread saves a tenth of such small steps on an idle machine, and on a busy one, where threads wait for
    # each other by spinning, makes them several times slower.
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def make_advantages(critic: ValueOperator, gamma: float, gae_lambda: float) -> GAE:
    """Return the module that adds `advantage` and `value_target` [T, 1] to samples.

    `A_t = delta_t + gamma lambda (1 - done_t) A_(t+1)` with
    `delta_t = r_t + gamma (1 - terminated_t) V(s'_t) - V(s_t)`: a truncated
    episode goes on beyond its last step as far as its value is concerned, a terminated one does not.

    Args:
        critic: Gives the values.
        gamma: Discount.
        gae_lambda: Decay of the estimate.
    """
    # On one stream of samples the vectorised form is the faster one (3 ms for 3,000 steps, the plain one 22 ms), and
    # two calls of the critic are no slower than one under vmap.
    return GAE(gamma=gamma, lmbda=gae_lambda, value_network=critic, vectorized=True, deactivate_vmap=True)


class _NotFiniteError(Exception):
    """A loss, a gradient or a parameter is not finite; the text says which."""


class _Learner:
    """Actor, critic, loss and optimiser of one training."""

    def __init__(
        self,
        ddt: DDT,
        actor: ProbabilisticActor,
        critic: ValueOperator,
        settings: PPOSettings,
        generator: torch.Generator,
    ) -> None:
        self._settings = settings
        self._generator = generator
        self._steps = 0
        self._value_network = value_network_of(critic)
        self._advantages = make_advantages(critic, settings.gamma, settings.gae_lambda)
        self._loss = ClipPPOLoss(
            actor,
            critic,
            clip_epsilon=settings.clip_epsilon,
            entropy_coeff=settings.entropy_coeff,
            critic_coeff=settings.critic_coeff,
            loss_critic_type="l2",
            normalize_advantage=True,
            functional=False,
            log_explained_variance=False,  # Nobody reads it, and it is one part in twenty of a gradient step.
        )
        self._parameters = [*ddt.parameters(), *critic.parameters()]
        self._optimizer = _OPTIMIZERS[settings.optimizer](
            [
                {"params": [ddt.threshold], "lr": settings.lr_thresholds or settings.lr_actor},
                {"params": [ddt.leaf_logits], "lr": settings.lr_actor},
                {"params": list(critic.parameters()), "lr": settings.lr_critic},
            ],
            foreach=True,
        )

    @torch.no_grad()
    def standardise_critic(self, samples: TensorDict) -> None:
        """Count the critic's features, and then its values, in units of their spreads over samples [T]."""
        observation = samples["observation"]
        self._value_network.standardise_features(observation.mean(0), _spread(observation))
        targets = self._advantages(samples.clone())["value_target"]
        self._value_network.standardise_values(targets.mean(0), _spread(targets))

    def set_entropy_coeff(self, progress: float) -> None:
        """Set the weight of the entropy bonus for an update, by its place among all from 0 to 1."""
        first, last = self._settings.entropy_coeff, self._settings.entropy_final
        if last is not None:
            self._loss.entropy_coeff.fill_(first + (last - first) * progress)

    def update(self, samples: TensorDict, record: TrainingRecord) -> TrainingRecord:
        """Train on one batch [T]; return the record that goes on from `record`."""
        returns = finished_returns(samples)
        record = replace(
            record,
            timesteps=record.timesteps + len(samples),
            updates=record.updates + 1,
            soft_return=float(returns.mean()) if len(returns) > 0 else record.soft_return,
        )
        try:
            losses = self._fit(samples)
        except _NotFiniteError as error:
            where = f"in update {record.updates}, after {self._steps} gradient steps"
            failure = f"{error} is not finite {where}"
            return replace(record, gradient_steps=self._steps, failure=failure)
        return replace(
            record,
            gradient_steps=self._steps,
            actor_loss=losses["loss_objective"].item(),
            critic_loss=losses["loss_critic"].item(),
            entropy=losses["entropy"].item(),
            clip_fraction=losses["clip_fraction"].item(),
            kl=losses["kl_approx"].item(),
        )

    def _fit(self, samples: TensorDict) -> TensorDict:
        """Take all gradient steps of an update; return the losses of the last one."""
        # Checked first: at an entropy that is no number TorchRL would turn to sampling, and raise.
        _require_finite("an observation", [samples["observation"], samples["next", "observation"]])
        _require_finite("a reward", [samples["next", "reward"]])
        batch = self._advantages(samples).select(*_BATCH_KEYS)
        for _ in range(self._settings.epochs):
            for minibatch in self._minibatches(batch):
                losses = self._step(minibatch)
        return losses

    def _minibatches(self, batch: TensorDict) -> list[TensorDict]:
        size = self._settings.minibatch_size
        if size is None or size >= len(batch):
            return [batch]
        # What does not fill a minibatch goes to the others: one sample alone has no advantage to be normalised by.
        shuffled = torch.randperm(len(batch), generator=self._generator)
        return [batch[rows] for rows in shuffled.tensor_split(len(batch) // size)]

    def _step(self, batch: TensorDict) -> TensorDict:
        """Take one gradient step on these samples; return the losses before it."""
        losses: TensorDict = self._loss(batch)
        total = losses["loss_objective"] + losses["loss_critic"] + losses["loss_entropy"]
        _require_finite("the loss", [total])
        self._optimizer.zero_grad()
        total.backward()
        _require_finite("a gradient", [p.grad for p in self._parameters if p.grad is not None])
        self._optimizer.step()
        _require_finite("a parameter", self._parameters)
        self._steps += 1
        return losses


def _require_finite(what: str, tensors: Iterable[Tensor]) -> None:
    # The largest magnitude is finite exactly where all entries are; a lone leaf has no threshold to look at.
    if not get_total_norm([tensor for tensor in tensors if tensor.numel() > 0], math.inf).isfinite():
        raise _NotFiniteError(what)
