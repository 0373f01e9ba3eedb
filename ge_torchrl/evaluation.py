"""Testing a tree file, or the tree of a run, again on episodes of the user's choice."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ge_torchrl.artefacts import CONFIG, HALL_OF_FAME_TREES, RunFolder
from ge_torchrl.environments.choose import open_route
from ge_torchrl.environments.spec import EnvironmentSpec, describe
from ge_torchrl.errors import ArtefactError
from ge_torchrl.report.closing import EvaluationSummary
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.serialization import TreeDocument, read_tree


def evaluate(
    path: Path, episodes: int, seed: int, route: str = "auto", nodes: int | None = None
) -> EvaluationSummary:
    """Test a tree on the episodes that `reset(seed=seed + i)` begins, `i` from 0 to `episodes - 1`.

    Args:
        path: A tree file, or a run folder, whose pruned tree is taken in the run's own environment.
        episodes: Number of episodes, at least 1.
        seed: Seed of the first episode.
        route: "auto", "compiled" or "gymnasium".
        nodes: Take the tree with so many decision nodes from the hall of fame of the run; None takes the champion.

    Returns:
        What the tree did.

    Raises:
        UserError: There is no such tree, it does not fit the environment, or the environment failed.
    """
    document, spec = _read(path, nodes)
    opened = open_route(spec, route)
    try:
        outcomes = opened.evaluate(Forest.stack([document.tree]), np.arange(seed, seed + episodes))
    finally:
        opened.close()
    returns = outcomes.returns[0]
    mean = float(returns.mean())
    return EvaluationSummary(
        environment=spec.id,
        mean=mean,
        std=float(returns.std()),
        min=float(returns.min()),
        max=float(returns.max()),
        episodes=episodes,
        seed=seed,
        solved=None if spec.solved_at is None else spec.is_solved(mean),
        solved_at=spec.solved_at,
        route=opened.name,
        decision_nodes=document.tree.n_decision_nodes,
    )


def _read(path: Path, nodes: int | None) -> tuple[TreeDocument, EnvironmentSpec]:
    if path.is_dir():
        folder = RunFolder(path)
        document = folder.read_tree() if nodes is None else folder.read_hall_of_fame_tree(nodes)
        return document, _environment(folder)
    if nodes is not None:
        raise ArtefactError(f"--nodes chooses a tree of a run, so expected a run's folder; got {path}")
    document = read_tree(path)
    run = path.parent.parent if path.parent.name == HALL_OF_FAME_TREES else path.parent
    if (run / CONFIG).exists():
        return document, _environment(RunFolder(run))
    labels = document.labels
    return document, describe(labels.environment, labels.features, labels.units, labels.actions)


def _environment(folder: RunFolder) -> EnvironmentSpec:
    env = folder.read_config().env
    return describe(env.id, env.features, env.units, env.actions, env.solved_at, env.max_episode_steps)
