"""What one refinement brings, by which part of the method: the same trees, refined in many ways.

    python tests/benchmarks/bench_refiners.py                  # some ten minutes an environment, on one core

One tree from each of 20 runs (seeds 20 to 39) of Grammatical Evolution alone, a random one of those that may be
refined, after few generations. Each variant refines all of them; before and after are means over 1,000 episodes that
nothing else sees. The environment's CMA-ES is given the steps that PPO took, snapshots and acceptance included, or its
seconds.
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from bench import composed

from ge_torchrl.environments.compiled_route import CompiledRoute
from ge_torchrl.experiment import plan
from ge_torchrl.report.statistics import bootstrap_interval
from ge_torchrl.report.tables import markdown
from ge_torchrl.search.candidate import Eligibility
from ge_torchrl.search.cmaes import CMAESRefiner
from ge_torchrl.search.evolution import Evolution
from ge_torchrl.search.fitness import TrainingEpisodes
from ge_torchrl.search.ppo_refiner import PPORefiner
from ge_torchrl.search.refinement import refine
from ge_torchrl.seeding import stream
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.simplify import simplify_forest

GENERATIONS = {"cartpole": 10, "mountaincar": 20, "acrobot": 10}
SEEDS = range(20, 40)
UNSEEN = np.arange(2_000_000, 2_001_000)


def config_of(environment, seed, *overrides):
    return composed(f"env={environment}", f"seed={seed}", "refiner=ppo", *overrides)


def tree_of(environment, seed):
    """Return the environment's specification, and a tree that may be refined; the next seed's where there is none."""
    while True:
        config = config_of(environment, seed)
        planned = plan(config)
        route = CompiledRoute(planned.spec, threads=1)
        episodes = TrainingEpisodes(
            config.evaluation.episode_seeds,
            config.evaluation.episodes,
            stream(seed, "training episodes"),
        )
        evolution = Evolution(config.ge, planned.tables, route, episodes, stream(seed, "evolution"))
        generation = evolution.first()
        for _ in range(GENERATIONS[environment]):
            generation = evolution.after(generation)
        forest = simplify_forest(evolution.map(generation.codons).forest, planned.spec.low, planned.spec.high)
        eligible = Eligibility(planned.spec.solved_at, config.env.lowest_fitness_excluded)
        candidates = [
            i
            for i in range(len(forest))
            if eligible.admits(int(forest.sizes[i]), float(generation.fitness[i]))
        ]
        if candidates:
            return planned.spec, forest.tree(int(stream(seed, "a tree to refine").choice(candidates)))
        seed += 1000


def variants_of(environment):
    refiner = config_of(environment, 0).refiner
    ppo = refiner.ppo

    def of(**changes):
        return replace(refiner, ppo=replace(ppo, **changes))

    return {
        "PPO, refiner=ppo": refiner,
        "features not scaled, alpha 1000": of(scale_features=False, alpha=1000.0),
        "critic not scaled": of(scale_critic=False),
        "critic not scaled, its learning rate 0.003": of(scale_critic=False, lr_critic=0.003),
        "alpha 50 instead of 5": of(alpha=50.0),
        "alpha annealed from 5 to 50": of(alpha_final=50.0),
        "leaves of Eq. 3 (leaf_scale 1)": of(leaf_scale=1.0),
        "learning rate 0.001, as in the thesis": of(lr_actor=0.001),
        "thresholds' learning rate 0.01": of(lr_thresholds=0.01),
        "minibatches of 250": of(minibatch_size=250),
        "a quarter of the steps": of(max_timesteps=ppo.max_timesteps // 4),
        "four times the steps": of(max_timesteps=ppo.max_timesteps * 4),
        "RMSprop": of(optimizer="rmsprop"),
        "gamma 0.95, lambda 0.95": of(gamma=0.95, gae_lambda=0.95),
        "entropy bonus constant": of(entropy_final=None),
        "last tree, not the best snapshot": of(snapshot_episodes=0),
        "accepted unseen": replace(refiner, acceptance_episodes=0),
        "last tree, accepted unseen": replace(of(snapshot_episodes=0), acceptance_episodes=0),
    }


def measured(spec, trees, refiner_of, config):
    """Return the mean returns before and after [P], and the seconds and steps of a refinement."""
    route = CompiledRoute(spec, threads=1)
    refined, steps, started = [], [], time.perf_counter()
    for i, tree in enumerate(trees):
        done = refine(refiner_of(route, i), route, tree, config, i, "bench")
        refined.append(done.tree)
        steps.append(done.env_steps)
    seconds = (time.perf_counter() - started) / len(trees)
    before, after = (
        route.evaluate(Forest.stack(some), UNSEEN).returns.mean(axis=1) for some in (trees, refined)
    )
    route.close()
    return before, after, seconds, np.array(steps)


def row(name, before, after, seconds, steps):
    gain = after - before
    low, high = bootstrap_interval(gain, np.random.default_rng(0))
    better, worse = (gain > 0).sum(), (gain < 0).sum()
    return [
        name,
        f"{before.mean():.1f}",
        f"{after.mean():.1f}",
        f"{gain.mean():+.1f} ({low:+.1f} to {high:+.1f})",
        f"{better} of {len(gain)}",
        str(worse),
        f"{steps.mean() / 1e3:.0f}",
        f"{seconds:.2f}",
    ]


def bench(environment):
    found = [tree_of(environment, seed) for seed in SEEDS]
    spec, trees = found[0][0], [tree for _, tree in found]
    rows = []
    for name, config in variants_of(environment).items():
        results = measured(spec, trees, lambda route, _, c=config: PPORefiner(route, c.ppo), config)
        rows.append(row(name, *results))
        print(".", end="", flush=True, file=sys.stderr)
        if len(rows) == 1:
            _, _, seconds, steps = results
    cmaes = composed(f"env={environment}", "refiner=cmaes").refiner.cmaes
    equal_steps = [replace(cmaes, max_timesteps=int(n)) for n in steps]
    as_accepted = variants_of(environment)["PPO, refiner=ppo"]
    for name, configs in (
        ("CMA-ES, equal steps", equal_steps),
        ("CMA-ES, equal seconds", [replace(cmaes, max_seconds=float(seconds))] * len(trees)),
    ):
        refiner_of = lambda route, i, c=configs: CMAESRefiner(route, c[i])  # noqa: E731
        rows.append(row(name, *measured(spec, trees, refiner_of, as_accepted)))
    head = ["variant", "before", "after", "gain", "better", "worse", "thousand steps", "s"]
    return f"**{spec.id}**, {len(trees)} trees\n\n{markdown(head, rows)}\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--environments", nargs="+", default=list(GENERATIONS), choices=list(GENERATIONS))
    parser.add_argument("--output", type=Path, help="a file for the tables, besides standard output")
    options = parser.parse_args()
    tables = []
    for environment in options.environments:
        tables.append(bench(environment))
        print(tables[-1], flush=True)
    if options.output:
        options.output.write_text("\n".join(tables))
