"""Proximal policy optimisation (PPO) of many differentiable trees at once, in TorchRL.

Source: Schulman et al., "Proximal policy optimization algorithms" (2017). The loss of a batch is the sum of the trees'
own losses, and Adam and RMSprop act entry by entry: each tree is trained as if it were alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial

import torch
from tensordict import TensorDict
from torch import Tensor
from torchrl.modules import ProbabilisticActor

from ge_torchrl.config import PPOConfig
from ge_torchrl.refiners.protocol import TrainingRecord
from ge_torchrl.refiners.rl.actor_critic import SoftTrees, ValueNetworks, make_critic
from ge_torchrl.refiners.rl.advantages import ScanGAE
from ge_torchrl.refiners.rl.loss import TreesPPOLoss
from ge_torchrl.refiners.rl.samples import Source, last_returns

# Each in the form that is quickest for few tensors.
_OPTIMIZERS: Mapping[str, Callable[..., torch.optim.Optimizer]] = {
    "adam": partial(torch.optim.Adam, fused=True),
    "rmsprop": partial(torch.optim.RMSprop, foreach=False),
}


def train(
    ddt: SoftTrees,
    actor: ProbabilisticActor,
    networks: ValueNetworks,
    source: Source,
    config: PPOConfig,
    max_timesteps: int,
    after_update: Callable[[], None] = lambda: None,
    after_epoch: Callable[[], None] = lambda: None,
) -> list[TrainingRecord]:
    """Train trees in place, side by side.

    A tree with a loss, gradient, parameter or sample that is not finite is put back to what it was and left alone from
    then on; the others go on. The result does not depend on how many threads torch is set to: training uses one.

    Args:
        ddt: The trees [R], trained in place.
        actor: The actor around them.
        networks: Their critics [R], trained in place.
        source: Where samples come from; the caller closes it.
        config: The hyperparameters.
        max_timesteps: Environment steps of each tree; what does not fill an update is not taken.
        after_update: Called after each update, to look at the trees as they then are.
        after_epoch: Called after each pass over the samples of an update; it may raise, to end the training.

    Returns:
        [R] what was done to each tree, and how it ended.
    """
    with _one_thread():
        _keep_freed_memory()
        learner = Learner(ddt, actor, networks, config)
        n_updates = max_timesteps // config.update_timesteps
        if config.standardise and n_updates > 0:
            learner.standardise(source.collect(config.update_timesteps))
            n_updates -= 1
        for update in range(n_updates):
            learner.set_entropy_coeff(update / max(n_updates - 1, 1))
            learner.update(source.collect(config.update_timesteps), after_epoch)
            if not learner.alive.any():
                break
            after_update()
        return learner.records()


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


def _keep_freed_memory() -> None:
    # The C library of Linux gives large blocks back to the system, and a gradient step then waits for their pages, by
    # up to a third of its time; not so up to the size of the largest block that was freed before, 32 MB at most.
    torch.empty(8_000_000)


class Learner:
    """Loss and optimiser of `R` trees in training, and which of them are still trained.

    Args:
        ddt: The trees.
        actor: The actor around them.
        networks: Their critics.
        config: The hyperparameters.

    Attributes:
        alive: [R] bool, False where a tree failed and was put back.
    """

    def __init__(
        self, ddt: SoftTrees, actor: ProbabilisticActor, networks: ValueNetworks, config: PPOConfig
    ) -> None:
        self._config = config
        self._ddt = ddt
        self._actor = actor
        self._networks = networks
        critic = make_critic(networks)
        self._advantages = ScanGAE(gamma=config.gamma, lmbda=config.gae_lambda, value_network=critic)
        self._loss = TreesPPOLoss(actor, critic, config.clip_epsilon, config.entropy_coeff)
        of_trees, of_critics = list(ddt.parameters()), list(networks.parameters())
        self._parameters = [*of_trees, *of_critics]
        self._before = [p.detach().clone() for p in self._parameters]
        self._optimizer = _OPTIMIZERS[config.optimizer](
            [{"params": of_trees, "lr": config.lr_actor}, {"params": of_critics, "lr": config.lr_critic}]
        )
        # One order of samples for all trees and all trainings: it says nothing about what is in them.
        self._shuffler = torch.Generator().manual_seed(0)
        self.alive = torch.ones(ddt.num_trees, dtype=torch.bool)
        self._all_alive = True
        self._failures: list[str | None] = [None] * ddt.num_trees
        self._timesteps = self._updates = 0
        self._gradient_steps = torch.zeros(ddt.num_trees, dtype=torch.int64)
        self._updates_of = torch.zeros(ddt.num_trees, dtype=torch.int64)
        self._soft_returns = torch.full((ddt.num_trees,), torch.nan, dtype=torch.float64)
        self._losses: TensorDict | None = None
        self._batch: TensorDict | None = None

    @torch.no_grad()
    def standardise(self, samples: TensorDict) -> None:
        """Count thresholds, and the critics' features and values, in units of their spreads over samples."""
        self._timesteps += samples.batch_size[1:].numel()
        observation = samples["observation"].flatten(1, -2)
        mean, spread = _mean_and_spread(observation)
        self._ddt.standardise(spread, mean)
        self._networks.standardise_features(mean, spread)
        targets = self._advantages(samples)["value_target"].flatten(1, -2)
        mean, spread = _mean_and_spread(targets)
        self._networks.standardise_values(mean, spread)

    def set_entropy_coeff(self, progress: float) -> None:
        """Set the weight of the entropy bonus for an update, by its place among all from 0 to 1."""
        first, last = self._config.entropy_coeff, self._config.entropy_final
        if last is not None:
            self._loss.entropy_coeff.fill_(first + (last - first) * progress)

    def update(self, samples: TensorDict, after_epoch: Callable[[], None] = lambda: None) -> None:
        """Train on one batch of samples [R, T] or [R, K, T]: all epochs of an update."""
        self._timesteps += samples.batch_size[1:].numel()
        self._updates += 1
        # Checked first, to say what it is.
        self._bury(~_all_finite(samples["observation"], samples["next", "observation"]), "an observation")
        self._bury(~_all_finite(samples["next", "reward"]), "a reward")
        self._batch = self._prepared(samples)
        for _ in range(self._config.epochs):
            for minibatch in self._minibatches(self._batch):
                self._step(minibatch)
            after_epoch()

    def records(self) -> list[TrainingRecord]:
        """Return what was done to each tree, [R]."""
        of_policy = {name: values.tolist() for name, values in self._last_values().items()}
        return [
            TrainingRecord(
                timesteps=self._timesteps,
                updates=int(self._updates_of[tree]),
                gradient_steps=int(self._gradient_steps[tree]),
                soft_return=float(self._soft_returns[tree]),
                failure=failure,
                **({name: values[tree] for name, values in of_policy.items()} if failure is None else {}),
            )
            for tree, failure in enumerate(self._failures)
        ]

    @torch.no_grad()
    def _prepared(self, samples: TensorDict) -> TensorDict:
        """Return the samples [R, T] with advantages, as the loss takes them."""
        returns = torch.from_numpy(last_returns(samples))
        is_new = self.alive & returns.isfinite()
        self._soft_returns = torch.where(is_new, returns, self._soft_returns)
        self._updates_of += self.alive
        if not self._all_alive:
            self._silence(samples)
        self._advantages(samples)
        keys = ("observation", "action", "action_log_prob", "advantage", "value_target")
        batch = {key: samples[key].flatten(1, samples.batch_dims - 1) for key in keys}
        # Column by column: what reads one feature of all samples then reads one piece of memory.
        batch["observation"] = batch["observation"].mT.contiguous().mT
        return TensorDict(batch, batch["action_log_prob"].shape)

    def _minibatches(self, batch: TensorDict) -> Iterator[TensorDict]:
        size, n_samples = self._config.minibatch_size, batch.batch_size[1]
        if size is None or size >= n_samples:
            yield batch
            return
        # What does not fill a minibatch goes to the others: one sample alone has no advantage to be normalised by.
        shuffled = torch.randperm(n_samples, generator=self._shuffler)
        for rows in shuffled.tensor_split(n_samples // size):
            part = {key: values.index_select(1, rows) for key, values in batch.items()}
            part["observation"] = batch["observation"].mT.index_select(2, rows).mT
            yield TensorDict(part, (batch.batch_size[0], len(rows)))

    def _step(self, batch: TensorDict) -> None:
        """Take one gradient step on these samples."""
        self._losses = self._loss(batch)
        own = self._losses["loss_objective"] + self._losses["loss_critic"] + self._losses["loss_entropy"]
        for parameter in self._parameters:
            parameter.grad = None
        alive = own if self._all_alive else torch.where(self.alive.unsqueeze(-1), own, 0.0)
        (alive.sum() / own.shape[1]).backward()
        self._optimizer.step()
        # What was not finite in a tree's loss or gradient is now in its parameters, and in no other tree's.
        if not _is_finite([own, *self._parameters]):
            self._bury(~_all_finite(own), "the loss")
            self._bury(~_all_finite(*(p.grad for p in self._parameters if p.grad is not None)), "a gradient")
            self._bury(~_all_finite(*self._parameters), "a parameter")
        self._gradient_steps += self.alive

    @torch.no_grad()
    def _bury(self, failed: Tensor, what: str) -> None:
        """Put failed trees [R] back to what they were, and let nothing of them reach a loss or a step again."""
        newly = failed & self.alive
        self.alive &= ~failed
        self._all_alive = bool(self.alive.all())
        for tree in self._indices(newly):
            where = f"in update {self._updates}, after {self._gradient_steps[tree]} gradient steps"
            self._failures[tree] = f"{what} is not finite {where}"
        if self._all_alive:
            return
        dead = ~self.alive
        for parameter, before in zip(self._parameters, self._before, strict=True):
            parameter[dead] = before[dead]
            states = self._optimizer.state[parameter].values()
            for tensor in (parameter.grad, *states):
                if isinstance(tensor, Tensor) and tensor.shape == parameter.shape:
                    tensor[dead] = 0
        if self._batch is not None:
            self._silence(self._batch)

    def _silence(self, samples: TensorDict) -> None:
        """Put samples of failed trees to 0: a loss made of them is finite."""
        for values in samples.values(include_nested=True, leaves_only=True):
            values[~self.alive] = 0

    @torch.no_grad()
    def _last_values(self) -> dict[str, Tensor]:
        """Return the losses of the last step, and what has become of the policies that sampled, [R] each."""
        if self._batch is None or self._losses is None:
            return {}
        now = self._actor.get_dist(self._batch)
        ratio = now.log_prob(self._batch["action"]) - self._batch["action_log_prob"]
        is_clipped = (ratio.exp() - 1).abs() > self._config.clip_epsilon
        return {
            "actor_loss": self._losses["loss_objective"].mean(1),
            "critic_loss": self._losses["loss_critic"].mean(1),
            "entropy": now.entropy().mean(1),
            "clip_fraction": is_clipped.float().mean(1),
            "kl": -ratio.mean(1),
        }

    @staticmethod
    def _indices(chosen: Tensor) -> list[int]:
        return chosen.nonzero().flatten().tolist()


def _mean_and_spread(values: Tensor) -> tuple[Tensor, Tensor]:
    """Return mean and standard deviation [R, D] over samples [R, T, D]; 0 and 1 where they tell nothing."""
    spread, mean = torch.std_mean(values.double(), 1)
    # A feature that never moved has no scale of its own, and neither has one that is not a number.
    return mean.nan_to_num(0.0, 0.0, 0.0).float(), torch.where(
        spread.isfinite() & (spread > 0), spread, 1.0
    ).float()


def _all_finite(*tensors: Tensor) -> Tensor:
    """Return [R], whether all entries of a tree in tensors [R, ...] are finite."""
    return torch.stack([tensor.isfinite().flatten(1).all(1) for tensor in tensors]).all(0)


def _is_finite(tensors: Iterable[Tensor]) -> bool:
    # A sum is finite only where all entries are. Large ones may overflow, which costs no more than a closer look.
    return bool(torch.stack([tensor.sum() for tensor in tensors]).sum().isfinite())
