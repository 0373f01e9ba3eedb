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

leaf, value_leaf, split = DecisionTree.leaf, DecisionTree.value_leaf, DecisionTree.split
LUNAR_LANDER = "LunarLander-v3"
STEPS, ROUNDS = 100, 5


def of_cartpole(observation):
    if observation[2] < 0.0154:
        return 0 if observation[3] < 0.2290 else 1
    return 1


def of_acrobot(observation):
    if observation[5] < -14.2778:
        return 0
    return 0 if observation[5] < 0.3094 else 2


def of_lunar_lander(observation):
    if observation[4] < -0.07:
        return 1
    return 2 if observation[3] < -0.3 else 3


def of_pendulum(observation):
    if observation[0] < 0.7:
        torque = 0.3 + 1.5 * observation[2] - 8 * observation[1]
    else:
        torque = -9 * observation[1] - 2 * observation[2]
    return np.clip(np.array([torque], np.float32), -2, 2)


def of_continuous_lander(observation):
    main = 0.6 if observation[3] < -0.2 else -1.0
    return np.clip(np.array([main, 2 * observation[4] + observation[5]], np.float32), -1, 1)


LATERAL = {4: [0.0, 2.0], 5: [0.0, 1.0]}
TREES = {
    "CartPole-v1": (split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1)), of_cartpole),
    "Acrobot-v1": (split(5, -14.2778, leaf(0), split(5, 0.3094, leaf(0), leaf(2))), of_acrobot),
    "Pendulum-v1": (
        split(0, 0.7, value_leaf([0.3], {2: [1.5], 1: [-8.0]}), value_leaf([0.0], {1: [-9.0], 2: [-2.0]})),
        of_pendulum,
    ),
    LUNAR_LANDER: (split(4, -0.07, leaf(1), split(3, -0.3, leaf(2), leaf(3))), of_lunar_lander),
    "LunarLanderContinuous-v3": (
        split(3, -0.2, value_leaf([0.6, 0.0], LATERAL), value_leaf([-1.0, 0.0], LATERAL)),
        of_continuous_lander,
    ),
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


def against_the_plain_loop(environment_id: str, workers: int, blocks: int = 9, episodes: int = 30) -> None:
    """Compare by the processor's time in one process, by the wall clock's in two."""
    clock = time.process_time if workers == 1 else time.perf_counter
    tree, decide = TREES[environment_id]
    forest, environment = Forest.stack([tree]), gym.make(environment_id)
    backend = GymnasiumBackend(describe(environment_id), workers)
    ratios, rates = [], []
    for block in range(blocks + 1):
        seeds = np.arange(episodes) + episodes * block
        started = clock()
        steps = backend.evaluate(forest, seeds, "bench").env_steps
        ours = steps / (clock() - started)
        started = clock()
        # A plain loop sums in float32: where actions are numbers, episodes may part ways.
        theirs = plain_loop(environment, decide, seeds.tolist()) / (clock() - started)
        ratios.append(ours / theirs)
        rates.append(ours)
    # The first block pays for what is made once.
    print(
        f"{environment_id:24}  {workers} process{'es' if workers > 1 else ''}: "
        f"{statistics.median(rates[1:]):8,.0f} steps a second, {statistics.median(ratios[1:]):.2f} of a plain loop's",
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
        for processes in (1, 2):
            against_the_plain_loop(each, processes)
    for n_copies in (64, 128):
        print(f"LunarLander-v3 under TorchRL's collector, {n_copies} copies, frames a second:", flush=True)
        frames_a_second(n_copies)
    # Processes that TorchRL started in several ways keep Python waiting for its resource tracker: all is printed.
    os._exit(0)
