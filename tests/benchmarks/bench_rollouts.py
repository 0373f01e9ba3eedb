"""How fast kernels run trees, beside the loop over Gymnasium that everybody writes.

Times are the best of a few repetitions, since other work on the machine only ever adds to them.
"""

import argparse
import itertools
import time
from pathlib import Path

import gymnasium as gym
import numpy as np
import yaml
from rich.console import Console
from rich.table import Table

from ge_torchrl.environments.backend import SoftForest, available_cores
from ge_torchrl.environments.kernel_backend import KernelBackend
from ge_torchrl.environments.spec import describe
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.ge.operators import random_population
from ge_torchrl.ge.rule_tables import compile_rules
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.simplify import simplify
from ge_torchrl.trees.tree import DecisionTree

ENVIRONMENTS = ("cartpole", "mountaincar", "acrobot")
TREES, EPISODES = 200, 128
SOFT_TREES, SOFT_STEPS = 20, 10_000
_GENOTYPE_LENGTH = 256
_CONF = Path(__file__).resolve().parents[2] / "conf"
console = Console(width=110)


def task(environment: str):
    """The description of an environment, and the tables of the thesis' grammar for it."""
    named = yaml.safe_load((_CONF / f"env/{environment}.yaml").read_text())["env"]
    grammar = yaml.safe_load((_CONF / f"grammar/thesis/{environment}.yaml").read_text())["bnf"]
    spec = describe(named["id"], *(tuple(named[key]) for key in ("features", "units", "actions")))
    return spec, compile_rules(read_grammar(grammar, named["features"], named["actions"]))


def random_forest(spec, tables, n: int, rng):
    """Trees of random genotypes, simplified, as fitness meets them; some have none."""
    return simplify(map_population(random_population(n, _GENOTYPE_LENGTH, rng), tables), spec.low, spec.high)


def distinct_trees(environment: str, n: int):
    """Trees of random genotypes, all different."""
    spec, tables = task(environment)
    rng, trees = np.random.default_rng(0), {}
    while len(trees) < n:
        forest = random_forest(spec, tables, 500, rng)
        for index in np.flatnonzero(forest.num_decision_nodes > 0):
            trees.setdefault(forest.tree(index))
    return spec, list(itertools.islice(trees, n))


def gymnasium_loop(spec, trees, seconds: float) -> float:
    """Steps per second of the loop that everybody writes: one environment, one tree, plain Python."""
    environment = gym.make(spec.id)
    nested = [as_nested(tree, 0) for tree in trees]
    steps, started = 0, time.perf_counter()
    for seed, tree in zip(itertools.count(), itertools.cycle(nested), strict=False):
        observation, _ = environment.reset(seed=seed)
        ended = False
        while not ended:
            node = tree
            while isinstance(node, tuple):
                feature, threshold, left, right = node
                node = left if observation[feature] < threshold else right
            observation, _, terminated, truncated, _ = environment.step(node)
            ended = terminated or truncated
            steps += 1
        if time.perf_counter() - started > seconds:
            return steps / (time.perf_counter() - started)
    raise AssertionError


def as_nested(tree, node: int):
    """The tree as nested tuples, the quickest form for plain Python."""
    if node < 0:
        return int(tree.action[~node])
    children = int(tree.children_left[node]), int(tree.children_right[node])
    return int(tree.feature[node]), tree.threshold[node], *(as_nested(tree, child) for child in children)


def best_of(n: int, function) -> float:
    """Seconds of the fastest of `n` calls."""
    times = []
    for _ in range(n):
        started = time.perf_counter()
        function()
        times.append(time.perf_counter() - started)
    return min(times)


def soft_forest(trees, n_actions: int, alpha: float) -> SoftForest:
    """Trees of some hundred steps an episode, each leaf as sure of its action as PPO's are when it begins."""
    n_splits = max(tree.num_decision_nodes for tree in trees)

    def padded(arrays, fill, dtype, width):
        return np.array(
            [np.pad(array, (0, width - len(array)), constant_values=fill) for array in arrays], dtype
        )

    actions = padded([tree.action for tree in trees], 0, np.int64, n_splits + 1)
    logits = np.log(n_actions - 1 + 1e-9) + np.eye(n_actions)[actions]
    probabilities = np.exp(logits) / np.exp(logits).sum(2, keepdims=True)
    return SoftForest.with_actions(
        padded([tree.feature for tree in trees], 0, np.int32, n_splits),
        padded([tree.threshold for tree in trees], 0, np.float32, n_splits),
        np.full((len(trees), n_splits), alpha),
        padded([tree.children_left for tree in trees], ~0, np.int32, n_splits),
        padded([tree.children_right for tree in trees], ~0, np.int32, n_splits),
        probabilities,
    )


def bench_rollouts() -> None:
    """Print what kernels make of hard trees, and of soft ones that PPO samples."""
    table = Table(
        title=f"{TREES} different trees on {available_cores()} cores, and {SOFT_TREES} soft trees sampled "
        "side by side: million environment steps a second"
    )
    columns = (
        "Gymnasium loop",
        "5 episodes a tree",
        "ratio",
        f"{EPISODES} episodes",
        "ratio",
        "sampled",
        "ratio",
    )
    for column in ("environment", *columns):
        table.add_column(column, justify="left" if column == "environment" else "right")
    for environment in ENVIRONMENTS:
        spec, trees = distinct_trees(environment, TREES)
        rival = gymnasium_loop(spec, trees, seconds=3)
        cells = [spec.id, f"{rival / 1e6:.3f}"]
        backend, forest = KernelBackend(spec), Forest.stack(trees)
        for n_episodes in (5, EPISODES):
            seeds = np.arange(n_episodes)
            steps = backend.evaluate(forest, seeds, "bench").env_steps
            rate = steps / best_of(7, lambda b=backend, f=forest, s=seeds: b.evaluate(f, s, "bench"))
            cells += [f"{rate / 1e6:.0f}", f"{rate / rival:.0f} x"]
        soft = soft_forest(trees[:SOFT_TREES], spec.n_actions, alpha=10.0)
        sampler = backend.sampler([np.random.default_rng(r) for r in range(SOFT_TREES)])
        seconds = best_of(7, lambda s=sampler, f=soft: s.sample(f, SOFT_STEPS, "bench"))
        rate = SOFT_TREES * SOFT_STEPS / seconds
        cells += [f"{rate / 1e6:.0f}", f"{rate / rival:.0f} x"]
        backend.close()
        table.add_row(*cells)
    console.print(table)


def summing_trees():
    """Three splits on one feature each, on four, and rules of a split and two laws: name, environment, trees."""
    leaf, law, rng = DecisionTree.leaf, DecisionTree.value_leaf, np.random.default_rng(0)

    def three_splits(n_terms: int) -> DecisionTree:
        # The features are sines, cosines and speeds, in this order.
        features, weights = [4, 5, 1, 3][:n_terms], [1.0, 0.3, 0.2, 0.1][:n_terms]
        thresholds = rng.normal(size=3) * 0.3
        halves = [
            DecisionTree.weighted_split(features, weights, float(threshold), leaf(0), leaf(2))
            for threshold in thresholds[1:]
        ]
        return DecisionTree.weighted_split(features, weights, float(thresholds[0]), *halves)

    def force(*slopes: float) -> DecisionTree:
        split_on = len(slopes) - 1
        laws = [law([0.1], {f: [slope * factor] for f, slope in enumerate(slopes)}) for factor in (1.0, 0.7)]
        return DecisionTree.split(split_on, float(rng.normal() * 0.01), *laws)

    yield "Acrobot-v1, 3 splits", "Acrobot-v1", [three_splits(1) for _ in range(TREES)]
    yield "Acrobot-v1, 3 splits of 4 terms", "Acrobot-v1", [three_splits(4) for _ in range(TREES)]
    yield "Pendulum-v1, 2 laws", "Pendulum-v1", [force(-1.0, -9.0, -2.0) for _ in range(TREES)]
    two_laws = [force(0.3, 20.0) for _ in range(TREES)]
    yield "MountainCarContinuous-v0, 2 laws", "MountainCarContinuous-v0", two_laws


def bench_sums() -> None:
    """Print what weighted sums cost in splits and in leaves."""
    table = Table(title=f"{TREES} trees of sums: million environment steps a second")
    for column in ("trees", "5 episodes a tree", f"{EPISODES} episodes"):
        table.add_column(column, justify="left" if column == "trees" else "right")
    for name, environment_id, trees in summing_trees():
        backend, forest, cells = KernelBackend(describe(environment_id)), Forest.stack(trees), []
        for n_episodes in (5, EPISODES):
            seeds = np.arange(n_episodes)
            steps = backend.evaluate(forest, seeds, "bench").env_steps
            seconds = best_of(7, lambda b=backend, f=forest, s=seeds: b.evaluate(f, s, "bench"))
            cells.append(f"{steps / seconds / 1e6:.0f}")
        backend.close()
        table.add_row(name, *cells)
    console.print(table)


def bench_linearity() -> None:
    """Print how the cost grows with the number of trees and of episodes."""
    table = Table(title="Cost is linear: seconds of evaluating random trees of CartPole (best of 7)")
    for column in ("doubled", "1 x", "2 x", "4 x", "8 x", "8 x / 1 x"):
        table.add_column(column, justify="left" if column == "doubled" else "right")
    spec, tables = task("cartpole")
    backend = KernelBackend(spec)

    def seconds_of(population: int, episodes: int) -> float:
        forest = random_forest(spec, tables, population, np.random.default_rng(1))
        seeds = np.arange(episodes)
        return best_of(7, lambda: backend.evaluate(forest, seeds, "bench"))

    rows = {
        "population (1,000 trees, 8 episodes)": [seconds_of(1000 * n, 8) for n in (1, 2, 4, 8)],
        "episodes (1,000 trees, 64 episodes)": [seconds_of(1000, 64 * n) for n in (1, 2, 4, 8)],
    }
    backend.close()
    for name, seconds in rows.items():
        table.add_row(name, *(f"{s:.4f}" for s in seconds), f"{seconds[-1] / seconds[0]:.1f}")
    console.print(table)


if __name__ == "__main__":
    argparse.ArgumentParser(description="Measure the speed of the program beside its rivals.").parse_args()
    bench_rollouts()
    bench_sums()
    bench_linearity()
