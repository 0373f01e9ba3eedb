"""Testing a tree file, the tree of a run, or those of many runs, again on episodes of the user's choice."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.artefacts.folder import BEST_TREE, CONFIG, find_runs, none_found
from ge_torchrl.environments.choose import open_backend
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.errors import UserError
from ge_torchrl.reading import is_folder, is_there
from ge_torchrl.report.candidates import Candidates, candidates_of, restricted, told_apart
from ge_torchrl.report.evaluated import EvaluatedMethod, EvaluatedRun, EvaluationSummary, SweepEvaluation
from ge_torchrl.report.measuring import Meter, Told, tell_nobody
from ge_torchrl.report.methods import METHODS
from ge_torchrl.report.reading import read_tree
from ge_torchrl.report.sizes import SizedTree
from ge_torchrl.report.tables import RunRow
from ge_torchrl.report.twins import twins_told, without_twins
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.tree import DecisionTree

_TEST, _VALIDATION = "test", "validation"


def evaluate(
    path: Path,
    episodes: int,
    seed: int,
    route: str = "auto",
    nodes: int | None = None,
    told: Told = tell_nobody,
) -> EvaluationSummary:
    """Test a tree on the episodes that `reset(seed=seed + i)` begins, `i` from 0 to `episodes - 1`.

    Args:
        path: A tree file, or a run folder, whose pruned tree is taken in the run's own environment.
        episodes: Number of episodes, at least 1.
        seed: Seed of the first episode.
        route: "auto", "kernel" or "gymnasium".
        nodes: Take the tree with so many decision nodes from the archive of the run; None takes the champion.
        told: Is told how far the test is.

    Returns:
        What the tree did.

    Raises:
        UserError: There is no such tree, it does not fit the environment, or the environment failed.
    """
    return evaluate_tree(*read_tree(path, nodes), episodes, seed, route, told)[0]


def evaluate_tree(
    tree: DecisionTree,
    spec: EnvironmentSpec,
    episodes: int,
    seed: int,
    route: str = "auto",
    told: Told = tell_nobody,
) -> tuple[EvaluationSummary, NDArray[np.float64]]:
    """Test a tree in an environment; see `evaluate`.

    Returns:
        What the tree did, and what it returned in each episode, [E] float64.
    """
    with closing(open_backend(spec, route)) as backend:
        (returns,) = Meter(backend, episodes, told).returns([tree], np.arange(seed, seed + episodes), _TEST)
    mean = float(returns.mean())
    summary = EvaluationSummary(
        environment=spec.id,
        mean=mean,
        std=float(returns.std()),
        min=float(returns.min()),
        max=float(returns.max()),
        episodes=episodes,
        seed=seed,
        solved=_is_solved(spec, mean),
        solved_at=spec.solved_at,
        route=backend.name,
        decision_nodes=tree.num_decision_nodes,
    )
    return summary, returns


def is_above_runs(path: Path) -> bool:
    """Tell whether a path is a folder that is not itself a run's, so that runs can only lie below it."""
    return is_folder(path) and not any(is_there(path / name) for name in (CONFIG, BEST_TREE))


def evaluate_runs(
    folder: Path,
    episodes: int,
    seed: int,
    route: str = "auto",
    nodes: int | None = None,
    told: Told = tell_nobody,
) -> SweepEvaluation:
    """Test the trees of all finished runs below a folder on the same episodes, as `evaluate` tests one.

    Of runs with one configuration and seed one is tested.

    Each run validated its trees on episodes of its own, so that these means do not tell which run's tree of a size is
    best. The trees of archives are validated once more, on as many episodes as the test has, the same for all.

    Args:
        folder: The folder, with runs at any depth: of each the champion and its archive, if it kept one.
        episodes: Number of episodes, at least 1.
        seed: Seed of the first episode.
        route: "auto", "kernel" or "gymnasium".
        nodes: Test the trees with so many decision nodes alone, of the runs that have one; None tests all.
        told: Is told how far each task is.

    Returns:
        What the trees did, in the order of environments, methods and seeds.

    Raises:
        UserError: No run can be tested, none has a tree of that size, or an environment failed.
    """
    runs: list[Candidates] = []
    left_out: list[str] = []
    for found in find_runs(folder):
        try:
            runs.append(candidates_of(found))
        except UserError as error:
            left_out.append(f"{found.path}: {error}")
    if not runs:
        raise none_found(folder, left_out)
    runs, twins = without_twins(runs)
    left_out += twins_told(twins)
    if nodes is not None:
        left_out += [
            f"{run.path}: it has no tree with {nodes} decision nodes" for run in runs if not run.of(nodes)
        ]
        runs = restricted(runs, nodes, folder)
    runs = sorted(
        told_apart(runs),
        key=lambda run: (*run.task, METHODS.index(run.method), run.setting, run.summary.seed, run.path),
    )
    methods = [
        method
        for _, alike in groupby(runs, key=lambda run: run.task)
        for method in _evaluate_task(list(alike), episodes, seed, route, told)
    ]
    return SweepEvaluation(episodes, seed, tuple(methods), tuple(left_out))


def _evaluate_task(
    runs: Sequence[Candidates], episodes: int, seed: int, route: str, told: Told
) -> Iterator[EvaluatedMethod]:
    """Test all trees of one task together, and yield what they did, method by method."""
    spec = runs[0].spec
    # A champion stands in its archive too, and small trees are found again and again.
    trees = list(dict.fromkeys(tree for run in runs for tree in run.trees))
    rivals = list(dict.fromkeys(tree for run in runs for tree in run.by_size))
    validation_seeds = episode_seeds("validation", episodes, stream(seed, "episodes that choose among runs"))
    with closing(open_backend(spec, route)) as backend:
        meter = Meter(backend, (len(trees) + len(rivals)) * episodes, told)
        tested = meter.means(trees, np.arange(seed, seed + episodes), _TEST)
        validated = meter.means(rivals, validation_seeds, _VALIDATION)
    means = {tree: mean for tree, (mean, _) in validated.items()}
    for (method, setting), alike in groupby(runs, key=lambda run: (run.method, run.setting)):
        yield EvaluatedMethod(
            environment=spec.names.environment,
            method=method,
            max_episode_steps=spec.max_episode_steps,
            solved_at=spec.solved_at,
            route=backend.name,
            runs=tuple(_evaluated(run, tested, means) for run in alike),
            setting=setting,
        )


def _evaluated(
    run: Candidates,
    tested: Mapping[DecisionTree, tuple[float, float]],
    validation_means: Mapping[DecisionTree, float],
) -> EvaluatedRun:
    mean, std = tested[run.chosen]
    summary = run.summary
    return EvaluatedRun(
        path=str(run.path),
        row=RunRow(
            summary.seed,
            run.chosen.num_decision_nodes,
            mean,
            std,
            _is_solved(run.spec, mean),
            summary.wall_seconds,
        ),
        by_size=tuple(
            SizedTree(
                summary.seed,
                tree.num_decision_nodes,
                *tested[tree],
                validation_means[tree],
                is_champion=tree == run.champion,
            )
            for tree in run.by_size
        ),
        refined=summary.refined,
    )


def _is_solved(spec: EnvironmentSpec, mean: float) -> bool | None:
    return None if spec.solved_at is None else spec.is_solved(mean)
