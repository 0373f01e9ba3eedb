"""What one refinement brings, by method and by its parts: the same trees, refined in many ways.

    python tests/benchmarks/bench_refiners.py                                    # half an hour on one core
    python tests/benchmarks/bench_refiners.py --rows short --route gymnasium     # where steps are dear: as long again
    python tests/benchmarks/bench_refiners.py --rows budgets --environments acrobot

One tree from each of 20 runs (seeds 20 to 39) of grammatical evolution alone, after few generations: a random one of
those that may be refined. Every row refines them all in one batch, as a generation of a run does, and measures them on
episodes that nothing else sees. Local search is given the environment steps that PPO took, or its seconds.

Further arguments are settings of the run, such as refiner.ppo.max_timesteps=20000, for all rows.
"""

import argparse
import contextlib
import io
import logging
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml
from refiner_rows import ROWS, Row

from ge_torchrl.__main__ import main
from ge_torchrl.config import Config, PolishConfig
from ge_torchrl.environments.backend import Backend
from ge_torchrl.environments.choose import open_backend
from ge_torchrl.refiners.local_search import LocalSearch
from ge_torchrl.refiners.protocol import Refiner
from ge_torchrl.refiners.rl.refiner import PPORefiner
from ge_torchrl.report.statistics import bootstrap_interval
from ge_torchrl.report.tables import Table
from ge_torchrl.run.plan import plan
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.proposals import INDIVIDUAL, Eligibility, Proposal
from ge_torchrl.search.refinement import is_clearly_better, refine_proposals
from ge_torchrl.search.step import first_state, step
from ge_torchrl.seeding import stream
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

ENVIRONMENTS = ("cartpole", "mountaincar", "acrobot", "lunarlander")

GENERATIONS = {"cartpole": 10, "mountaincar": 20, "acrobot": 10, "lunarlander": 5}

# Steps of LunarLander are dear: its trees come from smaller populations.
SMALLER = {"lunarlander": ("ge.population_size=100", "evaluation.episodes=5")}

UNSEEN = {"lunarlander": 200}

FIRST_UNSEEN = 2_000_000

QUICK = (
    "refiner.ppo.max_timesteps=4000",
    "refiner.ppo.snapshot_episodes=10",
    "refiner.acceptance_episodes=20",
    "refiner.measuring_episodes=5",
    "polish.max_timesteps=8000",
    "polish.episodes=5",
)

# More standard errors of the mean difference than chance gives.
ERRORS = 3.0

# A local search on fewer episodes takes luck for gain.
FEWEST_EPISODES = 20

# It stops where it has converged: so often its budget is set again until it took the seconds of its rival.
TRIES, NEARLY = 4, 0.8


@dataclass(frozen=True, eq=False)
class Measured:
    """What became of R trees; returns are [R, E], steps and seconds those of one tree."""

    before: np.ndarray
    hardened: np.ndarray
    after: np.ndarray
    soft: float
    steps: float
    accepting_steps: float
    seconds: float


class Timed:
    """A refiner that remembers what it gave, and the processor time that it took."""

    def __init__(self, refiner: Refiner) -> None:
        self._refiner, self.seconds, self.refined = refiner, 0.0, []

    def refine(self, trees, rngs, effort):
        started = time.process_time()
        self.refined = self._refiner.refine(trees, rngs, effort)
        self.seconds += time.process_time() - started
        return self.refined


def composed(*overrides: str) -> Config:
    """The configuration that the command line composes of these overrides."""
    shown = io.StringIO()
    with contextlib.redirect_stdout(shown):
        status = main(["--cfg", "job", *overrides])
    if status != 0:
        sys.exit(status)
    return Config.from_mapping(yaml.safe_load(shown.getvalue()))


def tree_of(environment: str, seed: int, generations: int) -> DecisionTree:
    """A tree that may be refined, of a run of GE alone; of another seed's where this one has none."""
    while True:
        config = composed(
            f"env={environment}",
            "refiner=none",
            "archive=none",
            f"seed={seed}",
            *SMALLER.get(environment, ()),
        )
        planned = plan(config)
        backend = open_backend(planned.spec, threads=1)
        problem = Problem(config.resolved(backend.steps_per_second), planned.tables, backend, None, None)
        state, _ = first_state(problem)
        for _ in range(generations):
            state, _ = step(problem, state)
        backend.close()
        forest, fitness = state.population.forest, state.population.fitness
        eligible = Eligibility(planned.spec.solved_at, config.env.lowest_return)
        candidates = [
            i
            for i in range(len(forest))
            if eligible.admits(int(forest.num_decision_nodes[i]), float(fitness[i]))
        ]
        if candidates:
            return forest.tree(int(stream(seed, "a tree to refine").choice(candidates)))
        seed += 1000


def scaled(polish: PolishConfig, max_timesteps: float) -> PolishConfig:
    """A local search with another budget: its episodes in proportion, so that it tries about as many trees."""
    share = max(max_timesteps / polish.max_timesteps, FEWEST_EPISODES / polish.episodes)
    return replace(polish, max_timesteps=round(max_timesteps), episodes=round(share * polish.episodes))


class Bench:
    """The trees of one environment, and the backend that refines them."""

    def __init__(self, environment: str, options: argparse.Namespace) -> None:
        settings = (*(QUICK if options.quick else ()), *options.settings)
        config = composed(f"env={environment}", "archive=none", "refiner.schedule.every=1", *settings)
        self.planned = plan(config)
        generations = 1 if options.quick else GENERATIONS[environment]
        self.trees = [tree_of(environment, seed, generations) for seed in range(20, 20 + options.trees)]
        self.backend = open_backend(self.planned.spec, options.route, threads=1, workers=1)
        self.judge = open_backend(self.planned.spec)
        self.unseen = FIRST_UNSEEN + np.arange(options.episodes or UNSEEN.get(environment, 1000))
        resolved = config.resolved(self.backend.steps_per_second)
        # Trees come back as they are, off the grammar's constants: what a method brings is not to be rounded away.
        self.config = replace(
            resolved,
            refiner=replace(resolved.refiner, write_back=False),
            polish=replace(resolved.polish, every=1),
        )

    def close(self) -> None:
        self.backend.close()
        self.judge.close()

    def measured(self, row: Row, trees: Sequence[DecisionTree] | None = None) -> Measured:
        """Refine all trees, and measure them before and after."""
        trees, backend = self.trees if trees is None else trees, self.backend
        refiner = Timed(refiner_of(backend, row))
        polisher = Timed(LocalSearch(backend, row.polish, "polish")) if row.polish else None
        config = replace(self.config, refiner=row.refiner)
        problem = Problem(config, self.planned.tables, backend, refiner, polisher)
        before = backend.steps.copy()
        proposals = [Proposal(tree, INDIVIDUAL, 0.0) for tree in trees]
        refinements = refine_proposals(problem, proposals, 1).refinements
        took = {name: n - before[name] for name, n in backend.steps.items()}
        steps = took.pop("refinement", 0) + took.pop("polish", 0)
        seconds = refiner.seconds + (polisher.seconds if polisher else 0.0)
        soft = [one.training.soft_return for one in refiner.refined]
        returns = [
            self.returns(some)
            for some in (trees, [one.tree for one in refiner.refined], [one.tree for one in refinements])
        ]
        return Measured(
            *returns,
            soft=float(np.nanmean(soft)) if np.isfinite(soft).any() else float("nan"),
            steps=steps / len(trees),
            accepting_steps=sum(took.values()) / len(trees),
            seconds=seconds / len(trees),
        )

    def returns(self, trees: Sequence[DecisionTree]) -> np.ndarray:
        return self.judge.evaluate(Forest.stack(trees), self.unseen, "bench").returns

    def rows(self, kind: str):
        """Measure the rows of one kind; local search beside PPO where PPO's parts are measured."""
        refiner, polish = self.config.refiner, self.config.polish
        self.measured(Row("first calls compile and import", refiner, polish=polish), self.trees[:2])
        ppo = None
        for row in ROWS[kind](refiner, polish):
            measured = self.measured(row)
            ppo = ppo or measured
            yield row.name, measured
        if kind not in ("parts", "short"):
            return
        budget = ppo.steps
        name, measured = self.searched("equal steps", scaled(polish, budget))
        yield name, measured
        for _ in range(TRIES):
            budget *= ppo.seconds / measured.seconds
            name, measured = self.searched("equal seconds", scaled(polish, budget))
            if measured.seconds >= NEARLY * ppo.seconds:
                break
        yield name, measured

    def searched(self, name: str, search: PolishConfig) -> tuple[str, Measured]:
        row = Row(f"local search, {name} ({search.episodes} episodes)", self.config.refiner, search=search)
        return row.name, self.measured(row)


def refiner_of(backend: Backend, row: Row) -> Refiner:
    if row.search is not None:
        return LocalSearch(backend, row.search, "refinement")
    return PPORefiner(backend, row.refiner.ppo, "refinement")


HEAD = ("", "before", "soft", "hardened", "after", "gain", "better, worse", "thousand steps", "s")


def cells(name: str, one: Measured) -> list[str]:
    gain = one.after.mean(axis=1) - one.before.mean(axis=1)
    low, high = bootstrap_interval(gain, np.random.default_rng(0))
    pairs = list(zip(one.before, one.after, strict=True))
    better = sum(is_clearly_better(new, old, ERRORS) for old, new in pairs)
    worse = sum(is_clearly_better(old, new, ERRORS) for old, new in pairs)
    return [
        name,
        f"{one.before.mean():.1f}",
        "" if np.isnan(one.soft) else f"{one.soft:.1f}",
        f"{one.hardened.mean():.1f}",
        f"{one.after.mean():.1f}",
        f"{gain.mean():+.1f} ({low:+.1f} to {high:+.1f})",
        f"{better}, {worse}",
        f"{one.steps / 1e3:,.0f}",
        f"{one.seconds:.2f}",
    ]


def table(environment: str, options: argparse.Namespace) -> str:
    """The table of one environment in Markdown."""
    bench = Bench(environment, options)
    rows, accepting = [], 0.0
    for name, measured in bench.rows(options.rows):
        accepting = accepting or measured.accepting_steps
        rows.append(cells(name, measured))
        print(".", end="", flush=True, file=sys.stderr)
    bench.close()
    print(file=sys.stderr)
    title = f"**{bench.planned.spec.id}**, {bench.backend.name}, {len(bench.trees)} trees"
    below = (
        f"Acceptance and measuring took {accepting / 1e3:,.0f} thousand steps a tree more in the first row."
    )
    return f"{title}\n\n{Table.of(HEAD, rows).markdown()}\n\n{below}\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--environments", nargs="+", default=ENVIRONMENTS, choices=ENVIRONMENTS)
    parser.add_argument("--rows", default="parts", choices=list(ROWS), help="which rows (default: parts)")
    parser.add_argument(
        "--route", default="auto", choices=("auto", "kernel", "gymnasium"), help="of refining"
    )
    parser.add_argument("--trees", type=int, help="how many trees (default: 20)")
    parser.add_argument("--episodes", type=int, help="unseen episodes (default: 1000, 200 of LunarLander's)")
    parser.add_argument(
        "--quick", action="store_true", help="three trees, small budgets: does it run at all?"
    )
    parser.add_argument("--output", type=Path, help="a file for the tables, besides standard output")
    parser.add_argument("settings", nargs="*", metavar="key=value", help="settings of the run, for all rows")
    options = parser.parse_intermixed_args()
    # What an environment observes outside its bounds is told by runs; here many backends would repeat it.
    logging.getLogger("ge_torchrl").setLevel(logging.ERROR)
    options.trees = options.trees or (3 if options.quick else 20)
    options.episodes = options.episodes or (20 if options.quick else None)
    tables = []
    for environment in options.environments:
        tables.append(table(environment, options))
        print(tables[-1], flush=True)
    if options.output:
        options.output.write_text("\n".join(tables))
