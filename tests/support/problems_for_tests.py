"""Small problems to search: CartPole in its kernel, or an environment whose returns a test writes down."""

from __future__ import annotations

import threading
from collections import Counter
from functools import cache, partial

import numpy as np
from fake_backend import FakeBackend

from ge_torchrl.config import Config
from ge_torchrl.environments.backend import Outcomes
from ge_torchrl.environments.kernel_backend import KernelBackend
from ge_torchrl.environments.spec import EnvironmentSpec, describe
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.rule_tables import RuleTables, compile_rules
from ge_torchrl.refiners.protocol import FIRST, Refined, TrainingRecord
from ge_torchrl.search.archive import Contender, Member
from ge_torchrl.search.problem import Problem
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.controller import Names
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

FEATURES, UNITS, ACTIONS = (
    ("x", "x_dot", "theta", "theta_dot"),
    ("m", "m/s", "rad", "rad/s"),
    ("left", "right"),
)
BNF = """
<if>        ::= if <condition> then <action> else <action>
<condition> ::= lt(theta, <constant>) | lt(theta_dot, <constant>)
<action>    ::= left | right | <if>
<constant>  ::= [-0.5, 0.5] step 0.01
"""

leaf, split = DecisionTree.leaf, DecisionTree.split
# It balances the pole for hundreds of steps.
GOOD = split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1))
# It acts as GOOD wherever an episode comes by, but no bound of an observation says so.
GOOD_WITH_DEAD_BRANCH = split(
    2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), split(3, -99.0, leaf(0), leaf(1))
)
POOR = split(3, 0.0, leaf(0), leaf(1))
# Of another structure than POOR, and of that of POOR.
POORER, POOR_MOVED = split(2, 0.02, leaf(0), leaf(1)), split(3, 0.3, leaf(0), leaf(1))
# It pushes the cart away from under the pole.
BAD = split(2, 0.0, split(3, 0.2290, leaf(1), leaf(0)), leaf(0))


def config_of(seed=0, **sections):
    """Return a small configuration without refinement and archive; `sections` change keys of theirs."""
    values = {
        "env": {"id": "CartPole-v1", "features": FEATURES, "units": UNITS, "actions": ACTIONS, "solved_at": 475},
        "grammar": {"name": "test", "bnf": BNF},
        "ge": {"population_size": 20, "generations": 6, "genotype_length": 40, "gene_probability": 0.1},
        "evaluation": {"episodes": 3, "validation_episodes": 30, "test_episodes": 20},
        "refiner": {"schedule": {"every": 2}, "acceptance_episodes": 0, "measuring_episodes": 5},
        "polish": {"every": 0},
        "archive": {
            "keep": 0, "episodes": 20, "max_nodes": 5, "neighbours": 0, "neighbours_drawn": 40, "revisit_factor": 0,
            "migrants": 0, "final_keep": 0, "final_factor": 3,
        },
        "seed": seed,
    }  # fmt: skip
    for name, changes in sections.items():
        values[name] = {**values[name], **changes}
    return Config.from_mapping(values).resolved(1e8)


def cartpole(threads=1):
    """Open CartPole's kernel; who does closes it."""
    return KernelBackend(describe("CartPole-v1", FEATURES, UNITS, ACTIONS), threads)


@cache
def _tables(bnf, features, actions) -> RuleTables:
    return compile_rules(read_grammar(bnf, features, actions))


def problem_of(backend, refines=None, polishes=None, config=None, **sections):
    """Return the problem of a small configuration, in which these two refine and polish."""
    config = config_of(**sections) if config is None else config
    names = backend.spec.names
    return Problem(
        config, _tables(config.grammar.bnf, names.features, names.actions), backend, refines, polishes
    )


class Analytic(FakeBackend):
    """CartPole's names and bounds, and whatever returns a test writes down; every leaf is visited.

    Args:
        value: Gives the return of a tree, but for the episode's luck, which all trees share.
        luck: Standard deviation of the episodes' luck.
        solved_at: Mean return from which the task is solved.
    """

    def __init__(self, value, luck=0.0, solved_at=None):
        super().__init__(value, spread=(1.0,) * len(FEATURES), luck=luck)
        low = np.array([-4.8, -np.inf, -0.42, -np.inf], np.float32)
        self.bounds = low, -low
        names = Names("Analytic-v0", FEATURES, UNITS, ACTIONS)
        self.spec = EnvironmentSpec("Analytic-v0", names, *self.bounds, 10, True, 0, solved_at)
        self.purposes = []

    def evaluate(self, forest, seeds, purpose, *, visits=False):
        self.purposes.append(purpose)
        outcomes = Outcomes.empty(len(forest), len(seeds))
        rows = np.flatnonzero(forest.valid)
        measured = super().evaluate(forest.take(rows), seeds, purpose)
        outcomes.returns[rows], outcomes.lengths[rows] = measured.returns, measured.lengths
        counts = np.full(int(forest.arrays.leaf_start[-1]), len(seeds)) if visits else None
        return Outcomes(outcomes.returns, outcomes.lengths, counts)


class Noting:
    """Passes everything on to a backend, notes its batches, and counts steps by itself, from what comes back.

    Attributes:
        counted: Environment steps by purpose.
        batches: Number of trees and purpose of each evaluation.
        seeds: The seeds of each evaluation.
    """

    def __init__(self, backend, counted=None, lock=None):
        self.__dict__.update(
            _backend=backend,
            counted=Counter() if counted is None else counted,
            batches=[],
            seeds=[],
            _lock=lock or threading.Lock(),
        )

    def __getattr__(self, name):
        return getattr(self._backend, name)

    def __setattr__(self, name, value):
        setattr(self._backend, name, value)

    def _count(self, purpose, n_steps):
        with self._lock:
            self.counted[purpose] += int(n_steps)

    def evaluate(self, forest, seeds, purpose, *, visits=False):
        self.batches.append((len(forest), purpose))
        self.seeds.append(seeds.tolist())
        outcomes = self._backend.evaluate(forest, seeds, purpose, visits=visits)
        self._count(purpose, outcomes.lengths.sum())
        if visits:
            assert outcomes.leaf_visits.sum() == outcomes.lengths.sum()
        return outcomes

    def observe(self, trees, n_steps, rngs, purpose):
        observed = self._backend.observe(trees, n_steps, rngs, purpose)
        self._count(purpose, observed.shape[0] * observed.shape[1])
        return observed

    def record(self, tree, seed):
        trajectory = self._backend.record(tree, seed)
        self._count("record", len(trajectory.rewards))
        return trajectory

    def sampler(self, rngs):
        return _NotedSampler(self._backend.sampler(rngs), self._count)

    def run_jobs(self, jobs):
        def noted(job, backend):
            return job(Noting(backend, self.counted, self._lock))

        return self._backend.run_jobs([partial(noted, job) for job in jobs])


class _NotedSampler:
    def __init__(self, sampler, count):
        self._sampler, self._count = sampler, count

    def sample(self, soft, n_steps, purpose):
        samples = self._sampler.sample(soft, n_steps, purpose)
        self._count(purpose, samples.actions.size)
        return samples


class Nudge:
    """A refiner that any machine repeats: it moves every number a little, and keeps what is better in two episodes.

    Args:
        backend: Measures trees.
        purpose: What the backend counts the steps under.

    Attributes:
        asked: The trees and the effort of each call.
    """

    def __init__(self, backend, purpose="refinement"):
        self._backend, self._purpose = backend, purpose
        self.asked = []

    def refine(self, trees, rngs, effort=FIRST):
        assert len(rngs) == len(trees)
        self.asked.append((list(trees), effort))
        return [self._refined(tree, rng, effort) for tree, rng in zip(trees, rngs, strict=True)]

    def _refined(self, tree, rng, effort):
        tries = max(1, round(4 * effort.factor))
        moves = 0.05 * effort.step * rng.uniform(-1, 1, size=(tries, len(tree.parameters)))
        forest = Forest.of_parameters(tree, np.float32([tree.parameters, *(tree.parameters + moves)]))
        outcomes = self._backend.evaluate(forest, episode_seeds("training", 2, rng), self._purpose)
        best = forest.tree(int(np.argmax(outcomes.returns.mean(axis=1))))
        return Refined(best, TrainingRecord(timesteps=outcomes.env_steps, updates=1))


class Answers:
    """A refiner that answers with what a test wrote down, and takes no steps.

    Args:
        answer: A tree for every question, or what makes one of the question.
        failure: What it says went wrong.

    Attributes:
        asked: The trees and the effort of each call.
    """

    def __init__(self, answer=lambda tree: tree, failure=None):
        self._answer = answer if callable(answer) else lambda _: answer
        self._training = TrainingRecord(timesteps=100, updates=2, gradient_steps=8, failure=failure)
        self.asked = []

    @property
    def trees(self):
        """All trees that it was asked to refine."""
        return [tree for trees, _ in self.asked for tree in trees]

    def refine(self, trees, rngs, effort=FIRST):
        assert len(rngs) == len(trees)
        self.asked.append((list(trees), effort))
        return [Refined(self._answer(tree), self._training) for tree in trees]


def moved_by(amount):
    """Return what moves every number of a tree."""
    return lambda tree: tree.with_parameters(tree.parameters + np.float32(amount))


def contender(tree, fitness=1.0, origin="population"):
    """Return a tree that might be kept."""
    return Contender(tree, fitness, origin)


def member(tree, archive_fitness=1.0, observed=None):
    """Return a kept tree that saw a few states, or those given."""
    states = np.random.default_rng(0).normal(size=(50, len(FEATURES))) if observed is None else observed
    return Member(tree, archive_fitness, archive_fitness, "population", np.float32(states))


def comb(*features, threshold=0.1):
    """Return a tree with a split on each feature, one below the other on the right."""
    tree = leaf(1)
    for feature in reversed(features):
        tree = split(feature, threshold, leaf(0), tree)
    return tree
