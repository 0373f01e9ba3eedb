"""What the budget of a refinement without gradients buys: the same trees, on more episodes, by more moves.

    python tests/benchmarks/bench_budget.py                 # five minutes on one core

Neighbours of the kept trees of a short run, the fittest of many on twenty episodes, as exploring chooses them. Each
variant refines all of them; before and after are means over 5,000 episodes that nothing else sees. A refinement takes
the best of what it has tried: on few episodes that is the luckiest.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from bench import composed

from ge_torchrl.__main__ import main
from ge_torchrl.artefacts import RunFolder
from ge_torchrl.environments.compiled_route import CompiledRoute
from ge_torchrl.experiment import plan
from ge_torchrl.refiner_section import CMAESConfig
from ge_torchrl.report.statistics import bootstrap_interval
from ge_torchrl.report.tables import markdown
from ge_torchrl.search.cmaes import CMAESRefiner
from ge_torchrl.seeding import stream
from ge_torchrl.trees.edits import EditedTree, stacked
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.simplify import simplify_forest

SIZES = range(4, 9)
DRAWN, CHOSEN = 200, 12
GENERATIONS = 15
UNSEEN = np.arange(2_000_000, 2_005_000)


def variants():
    """Return a name and settings for each: CMA-ES alone, moves on all episodes, and moves that are screened."""
    found = {}
    for episodes in (40, 100, 400):
        for first_step in (0.5, 0.02):
            found[f"CMA-ES, {episodes} episodes, first step {first_step}, 94 trees"] = CMAESConfig(
                max_timesteps=episodes * 7_500, episodes=episodes, first_step=first_step
            )
    for episodes in (40, 100, 400, 1000):
        found[f"8 moves a threshold, {episodes} episodes"] = CMAESConfig(
            max_timesteps=episodes * 10_000, episodes=episodes, first_step=0.02, moves=8
        )
    for episodes, steps in ((400, 1_000_000), (400, 2_500_000), (400, 10_000_000), (1000, 10_000_000)):
        found[f"8 moves, {episodes} episodes, screened on 100, {steps / 1e6:g} million steps"] = CMAESConfig(
            max_timesteps=steps, episodes=episodes, first_step=0.02, moves=8, screening_episodes=100
        )
    return found


def neighbours_of(kept, features, route, rng):
    """Return the fittest neighbours of a tree on twenty episodes, each of another structure."""
    edited = EditedTree.of(kept, route.observe(kept, 500, rng))
    nodes = [edited.neighbour(features, route.spec.n_actions, rng) for _ in range(DRAWN)]
    forest = simplify_forest(
        stacked(nodes),
        route.spec.low,
        route.spec.high,
    )
    fitness = route.evaluate(forest, UNSEEN[:20] + 1_000_000).returns.mean(axis=1)
    fittest = {}
    for i in np.argsort(-fitness, kind="stable"):
        tree = forest.tree(int(i))
        if tree.n_decision_nodes > 0:
            fittest.setdefault(tree.structure, tree)
    return list(fittest.values())[:CHOSEN]


def bench(environment, seed):
    config = composed(f"env={environment}", f"seed={seed}")
    planned = plan(config)
    route, rng = CompiledRoute(planned.spec, threads=1), stream(seed, "bench of budgets")
    with tempfile.TemporaryDirectory() as folder:
        run = [f"ge.generations={GENERATIONS}", "hall_of_fame.final_keep=0", f"hydra.run.dir={folder}/run"]
        if main([f"env={environment}", f"seed={seed}", *run]) != 0:
            sys.exit(1)
        kept = [RunFolder(Path(folder) / "run").read_hall_of_fame_tree(size).tree for size in SIZES]
    features = np.flatnonzero([len(of) > 0 for of in planned.tables.grammar.constants])
    trees = [tree for one in kept for tree in neighbours_of(one, features, route, rng)]
    before = route.evaluate(Forest.stack(trees), UNSEEN).returns.mean(axis=1)
    rows = []
    for name, settings in variants().items():
        started = time.perf_counter()
        tuned = CMAESRefiner(route, settings).tune(trees, rng.spawn(len(trees)))
        seconds = time.perf_counter() - started
        after = route.evaluate(Forest.stack([one.tree for one in tuned]), UNSEEN).returns.mean(axis=1)
        low, high = bootstrap_interval(after - before, np.random.default_rng(0))
        rows.append(
            [
                name,
                f"{(after - before).mean():+.2f} ({low:+.2f} to {high:+.2f})",
                f"{(after > before).sum()}, {(after < before).sum()}",
                f"{np.sort(before)[-10:].mean():.2f}, {np.sort(after)[-10:].mean():.2f}",
                f"{np.mean([one.env_steps for one in tuned]) / 1e6:.2f}",
                f"{1e3 * seconds / len(trees):.0f}",
            ]
        )
    route.close()
    head = ["refinement", "gain", "better, worse", "ten best before, after", "million steps", "ms"]
    return f"**{planned.spec.id}**, {len(trees)} trees, {before.mean():.2f} before\n\n{markdown(head, rows)}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--environment", default="acrobot", choices=("acrobot", "mountaincar", "cartpole"))
    parser.add_argument("--seed", type=int, default=20)
    options = parser.parse_args()
    print(bench(options.environment, options.seed))
