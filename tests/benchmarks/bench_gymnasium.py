"""`python tests/benchmarks/bench_gymnasium.py`: what stepping Gymnasium costs, beside its rivals in the same rounds.

First the backend against the loop that anybody would write, with the same tree; then TorchRL's collector over many
copies of LunarLander, by each way to spread them.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
import warnings
from collections.abc import Callable, Iterator
from functools import partial

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from tensordict.nn import TensorDictModule
from torchrl.collectors import Collector, MultiSyncCollector
from torchrl.envs import EnvBase, GymEnv, GymWrapper, ParallelEnv, RewardSum, TransformedEnv
from torchrl.modules import ProbabilisticActor

from ge_torchrl.environments.gymnasium_backend import GymnasiumBackend
from ge_torchrl.environments.spec import describe
from ge_torchrl.environments.torchrl_env import make_torchrl_env
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
LUNAR_LANDER = "LunarLander-v3"
STEPS, ROUNDS = 100, 5


def of_cartpole(observation):
    if observation[2] < 0.0154:
        return 0 if observation[3] < 0.2290 else 1
    return 1


def of_lunar_lander(observation):
    if observation[4] < -0.07:
        return 1
    return 2 if observation[3] < -0.3 else 3


TREES = {
    "CartPole-v1": (split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1)), of_cartpole),
    LUNAR_LANDER: (split(4, -0.07, leaf(1), split(3, -0.3, leaf(2), leaf(3))), of_lunar_lander),
}


def plain_loop(environment, decide, seeds) -> int:
    steps = 0
    for seed in seeds:
        observation, _ = environment.reset(seed=seed)
        ended = False
        while not ended:
            observation, _, terminated, truncated, _ = environment.step(decide(observation))
            ended = terminated or truncated
            steps += 1
    return steps


def against_the_plain_loop(environment_id: str) -> None:
    tree, decide = TREES[environment_id]
    forest, environment = Forest.stack([tree]), gym.make(environment_id)
    backend = GymnasiumBackend(describe(environment_id), workers=1)
    ratios, rates = [], []
    for block in range(9):
        seeds = np.arange(30) + 30 * block
        started = time.process_time()
        steps = backend.evaluate(forest, seeds, "bench").env_steps
        ours = time.process_time() - started
        started = time.process_time()
        assert plain_loop(environment, decide, seeds.tolist()) == steps
        theirs = time.process_time() - started
        ratios.append(theirs / ours)
        rates.append(steps / ours)
    print(
        f"{environment_id}: {statistics.median(rates):,.0f} steps a second of processor, "
        f"{statistics.median(ratios):.2f} of a plain loop's",
        flush=True,
    )
    backend.close()


def actor() -> ProbabilisticActor:
    network = torch.nn.Sequential(torch.nn.Linear(8, 16), torch.nn.Tanh(), torch.nn.Linear(16, 4))
    return ProbabilisticActor(
        TensorDictModule(network, ["observation"], ["logits"]),
        in_keys=["logits"],
        distribution_class=torch.distributions.Categorical,
        return_log_prob=True,
    )


def single() -> EnvBase:
    return GymEnv(LUNAR_LANDER, categorical_action_encoding=True)


def synchronous(n: int) -> EnvBase:
    copies = SyncVectorEnv([partial(gym.make, LUNAR_LANDER)] * n, autoreset_mode=AutoresetMode.DISABLED)
    return GymWrapper(copies, categorical_action_encoding=True)


def summed(make: Callable[[], EnvBase]) -> EnvBase:
    return TransformedEnv(make(), RewardSum())


def batches(environment: EnvBase, n: int) -> Collector:
    return Collector(environment, actor(), frames_per_batch=n * STEPS, total_frames=-1, track_traj_ids=False)


def multi_sync(n: int) -> MultiSyncCollector:
    makers = [partial(summed, partial(synchronous, n // 2))] * 2
    return MultiSyncCollector(makers, actor(), frames_per_batch=n * STEPS, total_frames=-1, cat_results=0)


def ways(n: int) -> dict[str, tuple[Collector, int]]:
    spec = describe(LUNAR_LANDER)
    return {
        "GymEnv, one copy": (batches(summed(single), 1), 1),
        "SyncVectorEnv": (batches(summed(partial(synchronous, n)), n), n),
        "ParallelEnv, 2 x SyncVectorEnv": (
            batches(summed(partial(ParallelEnv, 2, partial(synchronous, n // 2))), n),
            n,
        ),
        "make_torchrl_env, 1 process": (batches(make_torchrl_env(spec, n, workers=1), n), n),
        "make_torchrl_env, 2 processes": (batches(make_torchrl_env(spec, n, workers=2), n), n),
    }


def frames_a_second(n: int) -> None:
    opened = ways(n)
    iterators = {name: iter(collector) for name, (collector, _) in opened.items()}
    measured: dict[str, list[tuple[float, float]]] = {name: [] for name in opened}
    for _ in range(ROUNDS + 1):
        for name, samples in iterators.items():
            measured[name].append(timed(samples, opened[name][1] * STEPS))
    # Worker processes that nobody closes would keep this one from ending.
    for collector, _ in opened.values():
        collector.shutdown()
    # These processes go on collecting while nobody asks: they are measured when the others are quiet.
    free_running = multi_sync(n)
    samples = iter(free_running)
    measured["MultiSyncCollector, 2 x SyncVectorEnv"] = [timed(samples, n * STEPS) for _ in range(ROUNDS + 1)]
    free_running.shutdown()
    for name, rates in measured.items():
        # The first batch pays for what is made once.
        walls, processor = zip(*rates[1:], strict=True)
        print(
            f"  {name:40} {statistics.median(walls):8,.0f}  best {max(walls):8,.0f}"
            f"  processor of this process {statistics.median(processor):6.1f} us a frame",
            flush=True,
        )


def timed(samples: Iterator[object], frames: int) -> tuple[float, float]:
    """Return frames a second of wall clock, and microseconds of this process's processor a frame."""
    wall, processor = time.perf_counter(), time.process_time()
    next(samples)
    return frames / (time.perf_counter() - wall), (time.process_time() - processor) / frames * 1e6


if __name__ == "__main__":
    argparse.ArgumentParser(
        description="Measure what stepping Gymnasium costs, beside its rivals."
    ).parse_args()
    # What TorchRL will do otherwise some day does not change what is measured.
    warnings.filterwarnings("ignore", category=FutureWarning, module="torchrl")
    torch.set_num_threads(1)
    for each in TREES:
        against_the_plain_loop(each)
    for n_copies in (64, 128):
        print(f"LunarLander-v3 under TorchRL's collector, {n_copies} copies, frames a second:", flush=True)
        frames_a_second(n_copies)
    # Processes that TorchRL started in several ways keep Python waiting for its resource tracker: all is printed.
    os._exit(0)
