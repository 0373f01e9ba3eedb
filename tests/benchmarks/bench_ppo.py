"""`make bench`, second half: what refinement by PPO costs, each figure beside its rival in the same run.

    python tests/benchmarks/bench_ppo.py [trees] [thesis] [sampling]       # all three by default; some minutes

Seconds are the processor's. The rival of a batch is the same trees one by one; of one refinement as in the thesis,
stable-baselines3's PPO with the same settings and a network for an actor; of sampling, TorchRL's `GymEnv`.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import gymnasium as gym
import numpy as np
import torch
from bench_refiners import GENERATIONS, tree_of
from rich.console import Console
from rich.table import Table
from torchrl.collectors import Collector
from torchrl.envs import GymEnv

from ge_torchrl.config import PPOConfig
from ge_torchrl.environments.backend import Backend
from ge_torchrl.environments.choose import open_backend
from ge_torchrl.environments.spec import describe
from ge_torchrl.refiners.rl.actor_critic import make_actor
from ge_torchrl.refiners.rl.ddt import soften
from ge_torchrl.refiners.rl.refiner import PPORefiner
from ge_torchrl.refiners.rl.samples import open_source
from ge_torchrl.seeding import stream
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
# The tree printed in the thesis.
CARTPOLE = split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1))
SAMPLED = {
    "CartPole-v1": CARTPOLE,
    "MountainCar-v0": split(1, -0.0005, split(0, -1.0361, leaf(2), leaf(0)), leaf(2)),
    "Acrobot-v1": split(5, -14.2778, leaf(0), split(5, 0.3094, leaf(0), leaf(2))),
    "LunarLander-v3": split(4, -0.07, leaf(1), split(3, -0.3, leaf(2), leaf(3))),
}
TABLE_A1 = PPOConfig(
    max_timesteps=99_000,
    update_timesteps=3000,
    epochs=60,
    optimizer="rmsprop",
    lr_actor=0.001,
    lr_critic=0.001,
    gamma=0.95,
    gae_lambda=0.95,
    entropy_final=None,
    critic_hidden=(64, 64),
    alpha=1000.0,
    leaf_logit=None,
    standardise=False,
    snapshot_episodes=0,
)
UNSEEN = np.arange(2_000_000, 2_001_000)
console = Console(width=110)


def rngs(n: int, seed: int = 0):
    return [np.random.default_rng([seed, i]) for i in range(n)]


def seconds_of(work: Callable[[], object]) -> float:
    started = time.process_time()
    work()
    return time.process_time() - started


def table_of(title: str, *columns: str) -> Table:
    table = Table(title=title)
    for column in columns:
        table.add_column(column, justify="right" if table.columns else "left")
    return table


def refined(backend: Backend, config: PPOConfig, trees, seed: int, at_once: int):
    """Refine trees, so many at once."""
    results = []
    for first in range(0, len(trees), at_once):
        own = [stream(seed, f"bench {i}") for i in range(first, min(first + at_once, len(trees)))]
        results += PPORefiner(backend, config, "refinement").refine(trees[first : first + at_once], own)
    return [result.tree for result in results]


def bench_trees() -> None:
    """Twenty trees of GE alone, 40 thousand steps each."""
    table = table_of(
        "PPO by the defaults, 40 thousand steps: 20 trees of grammatical evolution alone",
        "environment", "trees at once", "seconds a tree", "gain", "better",
    )  # fmt: skip
    for environment, environment_id in {"mountaincar": "MountainCar-v0", "cartpole": "CartPole-v1"}.items():
        backend = open_backend(describe(environment_id), threads=1)
        trees = [tree_of(environment, seed, GENERATIONS[environment]) for seed in range(20, 40)]
        before = backend.evaluate(Forest.stack(trees), UNSEEN, "bench").returns.mean(1)
        config = PPOConfig()
        refined(backend, replace(config, max_timesteps=3000), trees[:2], 0, 2)
        for at_once, seeds in ((20, range(3)), (4, range(1)), (1, range(1))):
            gains, seconds = [], 0.0
            for seed in seeds:
                started = time.process_time()
                after = refined(backend, config, trees, seed, at_once)
                seconds += time.process_time() - started
                gains.append(backend.evaluate(Forest.stack(after), UNSEEN, "bench").returns.mean(1) - before)
            gain = np.array(gains)
            table.add_row(
                environment,
                str(at_once),
                f"{seconds / len(seeds) / len(trees):.3f}",
                f"{gain.mean():+.1f}",
                f"{(gain > 0).mean():.0%}",
            )
        backend.close()
    console.print(table)


def stable_baselines(config: PPOConfig) -> None:
    from stable_baselines3 import PPO

    model = PPO(
        "MlpPolicy",
        gym.make("CartPole-v1"),
        learning_rate=config.lr_actor,
        n_steps=config.update_timesteps,
        batch_size=config.update_timesteps,
        n_epochs=config.epochs,
        gamma=config.gamma,
        gae_lambda=config.gae_lambda,
        clip_range=config.clip_epsilon,
        ent_coef=config.entropy_coeff,
        vf_coef=0.5,
        policy_kwargs={"net_arch": list(config.critic_hidden)},
        device="cpu",
        seed=0,
    )
    model.learn(config.max_timesteps)


def bench_thesis() -> None:
    table = table_of(
        "One refinement with Table A.1, CartPole-v1: 33 updates of 3,000 steps, 60 epochs each", "", "seconds"
    )
    spec = describe("CartPole-v1")
    for route in ("kernel", "gymnasium"):
        backend = open_backend(spec, route, threads=1, workers=1)
        refiner = PPORefiner(backend, TABLE_A1, "refinement")
        PPORefiner(backend, replace(TABLE_A1, max_timesteps=3000), "first").refine([CARTPOLE], rngs(1))
        seconds = min(seconds_of(lambda: refiner.refine([CARTPOLE], rngs(1))) for _ in range(2))  # noqa: B023
        table.add_row(f"tree, {route}", f"{seconds:.1f}")
        backend.close()
    table.add_row("network, stable-baselines3", f"{seconds_of(lambda: stable_baselines(TABLE_A1)):.1f}")
    console.print(table)


def frames_a_second(collect: Callable[[int], object], frames: int, steps: int) -> float:
    """Return frames a second of the clock, after a first call; the best of three."""
    collect(steps)
    best = 0.0
    for _ in range(3):
        started = time.perf_counter()
        collect(steps)
        best = max(best, frames / (time.perf_counter() - started))
    return best


def bench_sampling() -> None:
    table = table_of(
        "Sampling 32 soft trees: thousand frames a second, all cores",
        "environment", "GymEnv, one tree", "collector, 32 trees", "kernel, 32 trees",
    )  # fmt: skip
    for environment_id, tree in SAMPLED.items():
        spec = describe(environment_id)
        ddt = soften([tree] * 32, spec.n_actions, 5.0, 0.0, 4.0)
        alone = soften([tree], spec.n_actions, 5.0, 0.0, 4.0)
        rival = Collector(
            GymEnv(environment_id, categorical_action_encoding=True),
            make_actor(alone),
            frames_per_batch=500,
            total_frames=-1,
            track_traj_ids=False,
            auto_register_policy_transforms=False,
        )
        cells = [f"{frames_a_second(lambda _: rival.next(), 500, 500) / 1e3:.1f}"]  # noqa: B023
        rival.shutdown()
        for route, steps in (("gymnasium", 400), ("kernel", 20_000)):
            if route == "kernel" and open_backend(spec).name != "kernel":
                cells.append("")
                continue
            backend = open_backend(spec, route)
            source = open_source(backend, ddt, make_actor(ddt), rngs(32), "bench")
            cells.append(f"{frames_a_second(source.collect, 32 * steps, steps) / 1e3:,.1f}")
            source.close()
            backend.close()
        table.add_row(environment_id, *cells)
    console.print(table)


def on_one_thread(work: Callable[[], None]) -> None:
    """As training does: threads that wait for each other cost more than such small tensors gain."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    work()
    torch.set_num_threads(threads)


PARTS = {"trees": bench_trees, "thesis": bench_thesis, "sampling": bench_sampling}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Measure what refinement by PPO costs, beside its rivals.")
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; default: all")
    chosen = parser.parse_args().parts or PARTS
    if unknown := set(chosen) - set(PARTS):
        parser.error(f"PART must be of {', '.join(PARTS)}; got {', '.join(sorted(unknown))}")
    for part in chosen:
        on_one_thread(PARTS[part])
