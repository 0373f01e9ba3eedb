"""Folders of finished runs with recorded episodes, written in a moment, for the tests of pages."""

from dataclasses import replace

import numpy as np
from records_for_tests import history, kept, refinement
from sweeps_for_tests import FULL, PRUNED, chain, controller, write_run

from ge_torchrl.artefacts.episodes import Episode, Episodes
from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.trees.controller import Controller

N_STEPS = 12


def episode(tree, name, rank, total, *, width=4, seed=0, values=0):
    """An episode of a tree that sees a wave; with `values` numbers as an action, or the tree's own actions."""
    steps = np.arange(N_STEPS + 1, dtype=np.float32)[:, np.newaxis]
    observations = (0.3 * np.sin(steps * 0.9 + np.arange(width) + seed)).astype(np.float32)
    actions = tree.decide(observations[:-1])
    assert values == 0 or actions.shape == (N_STEPS, values)
    rewards = np.full(N_STEPS, total / N_STEPS, np.float32)
    return Episode(name, rank, seed, total, N_STEPS, True, False, observations, actions, rewards)


def write_played_run(path, *, names=None, pruned=PRUNED, full=FULL, **changes):
    """Write a finished run with an archive, refinements and episodes; `changes` are of its summary."""
    sizes = (0, 1, 3)
    archive = [kept(size, 100.0 * size) for size in sizes]
    measured = {"decision_nodes": pruned.num_decision_nodes, "depth": pruned.depth, **changes}
    write_run(
        path, "GE+PPO+polish", archive=archive, generations=history([20.0, 90.0, 400.0, 480.0]),
        refinements=[refinement(1), refinement(2)], **measured,
    )  # fmt: skip
    folder = RunFolder(path)
    names = names or folder.read_best_tree().names
    if names != folder.read_best_tree().names:
        folder.write_trees(Controller(pruned, names), Controller(full, names), "a tree\n")
        folder.write_archive([])
    champion = [
        episode(pruned, "champion", rank, total, width=len(names.features), seed=seed)
        for seed, (rank, total) in enumerate([("best", 500.0), ("median", 490.0), ("worst", 100.0)])
    ]
    others = [] if names.features != controller(PRUNED).names.features else [
        episode(chain(size), str(size), "median", 100.0 * size + 1, seed=9) for size in sizes[:2]
    ]  # fmt: skip
    visits = {"champion": np.arange(1, pruned.num_leaves + 1), "full": np.arange(1, full.num_leaves + 1)}
    returns = np.array([500.0, 490.0, 100.0, 480.0])
    folder.write_episodes(Episodes(returns, visits, tuple(champion + others)))
    return folder


def with_names(names, **changes):
    """Return names of an environment with other ones."""
    return replace(names, **changes)
