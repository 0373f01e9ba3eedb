"""`make bench`, second half: what refinement costs, beside its rivals in the same run.

The rivals are the same refinement with samples from TorchRL's collector, and stable-baselines3's PPO with the same
settings and a network for an actor.
"""

import time

import numpy as np
import torch
from bench import composed, console, timed_run
from rich.table import Table

from ge_torchrl.environments.soft_rollouts import SoftSampler
from ge_torchrl.environments.spec import EnvironmentSpec, describe
from ge_torchrl.rl.ddt import soften
from ge_torchrl.rl.ppo import PPOSettings, train
from ge_torchrl.rl.samples import open_source
from ge_torchrl.trees.decision_tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
# The trees printed in the thesis.
TREES = {
    "CartPole-v1": split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1)),
    "MountainCar-v0": split(
        1,
        -0.0005,
        split(0, -1.0361, leaf(2), leaf(0)),
        split(1, 0.0063, split(0, -0.3981, leaf(2), leaf(0)), leaf(2)),
    ),
    "Acrobot-v1": split(5, -14.2778, leaf(0), split(4, -2.9144, leaf(1), split(5, 0.3094, leaf(0), leaf(2)))),
}
# Table A.1, which is also PPOConfig's default.
TABLE_A1 = PPOSettings(max_timesteps=100_000, update_timesteps=3000, epochs=60)


def softened(spec: EnvironmentSpec):
    return soften(TREES[spec.id], spec.n_actions, generator=torch.Generator().manual_seed(0))


def refinement_seconds(spec: EnvironmentSpec, source: str) -> float:
    samples = open_source(spec, source, rng=np.random.default_rng(0))
    started = time.perf_counter()
    record = train(softened(spec), samples, TABLE_A1, seed=0)
    seconds = time.perf_counter() - started
    samples.close()
    assert record.gradient_steps == 33 * 60
    return seconds


def collecting_seconds(spec: EnvironmentSpec, source: str) -> float:
    """Seconds of taking the samples of one refinement, without learning."""
    from ge_torchrl.rl.actor_critic import make_actor_critic

    samples = open_source(spec, source, rng=np.random.default_rng(0))
    actor, _ = make_actor_critic(
        softened(spec), spec.n_features, (64, 64), generator=torch.Generator().manual_seed(0)
    )
    samples.collect(actor, 3000)
    started = time.perf_counter()
    for _ in range(3):
        samples.collect(actor, 3000)
    samples.close()
    return (time.perf_counter() - started) * 11


def stable_baselines_seconds(spec: EnvironmentSpec) -> float:
    import gymnasium as gym
    from stable_baselines3 import PPO

    model = PPO(
        "MlpPolicy",
        gym.make(spec.id),
        learning_rate=TABLE_A1.lr_actor,
        n_steps=TABLE_A1.update_timesteps,
        batch_size=TABLE_A1.update_timesteps,
        n_epochs=TABLE_A1.epochs,
        gamma=TABLE_A1.gamma,
        gae_lambda=TABLE_A1.gae_lambda,
        clip_range=TABLE_A1.clip_epsilon,
        ent_coef=TABLE_A1.entropy_coeff,
        vf_coef=TABLE_A1.critic_coeff,
        policy_kwargs={"net_arch": [64, 64]},
        device="cpu",
        seed=0,
    )
    started = time.perf_counter()
    model.learn(33 * TABLE_A1.update_timesteps)
    return time.perf_counter() - started


def bench_refinement() -> None:
    table = Table(
        title="One refinement with Table A.1 on CartPole-v1: 33 updates of 3,000 steps, 60 epochs each"
    )
    for column in ("", "seconds", "of which sampling", "ratio to fused"):
        table.add_column(column, justify="left" if not column else "right")
    spec = describe("CartPole-v1")
    fused = refinement_seconds(spec, "fused")
    rows = {
        "tree, fused sampler": (fused, collecting_seconds(spec, "fused")),
        "tree, TorchRL collector over GymEnv": (
            refinement_seconds(spec, "collector"),
            collecting_seconds(spec, "collector"),
        ),
        "network, stable-baselines3 (its threads)": (stable_baselines_seconds(spec), float("nan")),
    }
    for name, (seconds, sampling) in rows.items():
        shown = "" if np.isnan(sampling) else f"{sampling:.3f}"
        table.add_row(name, f"{seconds:.1f}", shown, f"{seconds / fused:.1f} x")
    console.print(table)


def bench_sampling() -> None:
    table = Table(title="Sampling a soft tree, one thread: million frames a second")
    for column in ("environment", "TorchRL collector", "fused sampler", "goal", "ratio"):
        table.add_column(column, justify="left" if column == "environment" else "right")
    for environment_id in TREES:
        spec = describe(environment_id)
        rival = 99_000 / collecting_seconds(spec, "collector")
        sampler, tree = SoftSampler(spec, np.random.default_rng(0)), softened(spec).arrays()
        sampler.sample(tree, 10_000)
        started = time.perf_counter()
        for _ in range(10):
            sampler.sample(tree, 100_000)
        rate = 1_000_000 / (time.perf_counter() - started)
        table.add_row(environment_id, f"{rival / 1e6:.4f}", f"{rate / 1e6:.1f}", "2", f"{rate / rival:.0f} x")
    console.print(table)


def bench_thesis_runs() -> None:
    table = Table(title="A full run at the thesis' settings, GE and all its refinements")
    for column in ("environment", "evolution s", "of which PPO s", "refinements", "goal s"):
        table.add_column(column, justify="left" if column == "environment" else "right")
    for environment, goal in (("cartpole", 60), ("acrobot", 90), ("mountaincar", 60)):
        summary, _, _ = timed_run(composed(f"experiment=thesis/{environment}"))
        table.add_row(
            summary.environment,
            f"{summary.evolve_seconds:.1f}",
            f"{summary.refine_seconds:.1f}",
            str(summary.refinements),
            str(goal),
        )
    console.print(table)


if __name__ == "__main__":
    bench_refinement()
    bench_sampling()
    bench_thesis_runs()
