"""Reading a tree from disk, with the environment that it is measured in."""

from __future__ import annotations

import json
import logging
from pathlib import Path

from ge_torchrl.artefacts.folder import ARCHIVE_TREES, CONFIG, RunFolder
from ge_torchrl.environments.spec import EnvironmentSpec, describe, describe_settings
from ge_torchrl.errors import ArtefactError
from ge_torchrl.trees.controller import Controller, Names
from ge_torchrl.trees.files import read_controller
from ge_torchrl.trees.tree import DecisionTree

_logger = logging.getLogger(__name__)


def read_tree(path: Path, nodes: int | None) -> tuple[DecisionTree, EnvironmentSpec]:
    """Return a tree and the environment that it is measured in.

    Args:
        path: A tree's file, or a run's folder, whose champion is taken in the run's own environment.
        nodes: Take the tree with so many decision nodes from the archive of the run; None takes the champion.

    Raises:
        UserError: There is no such tree, or its environment is at fault.
    """
    if path.is_dir():
        folder = RunFolder(path)
        controller = folder.read_best_tree() if nodes is None else folder.read_archive_tree(nodes)
        spec = environment_of_run(folder)
        tell_of_another_plant(path, controller.names, spec)
        return controller.tree, spec
    if nodes is not None:
        raise ArtefactError(f"--nodes chooses a tree of a run, so expected a run's folder; got {path}")
    controller = read_controller(path)
    run = path.parent.parent if path.parent.name == ARCHIVE_TREES else path.parent
    of_run = environment_of_run(RunFolder(run)) if (run / CONFIG).exists() else None
    spec = _environment_of(controller, of_run)
    tell_of_another_plant(path, controller.names, spec)
    return controller.tree, spec


def environment_of_run(folder: RunFolder) -> EnvironmentSpec:
    """Describe the environment of a run.

    Raises:
        UserError: The run's configuration cannot be read, or the environment is at fault.
    """
    return describe_settings(folder.read_config().env)


def _environment_of(controller: Controller, of_run: EnvironmentSpec | None) -> EnvironmentSpec:
    """Describe the environment that a tree's own file names, wherever it lies; its run may know a threshold."""
    names = controller.names
    if of_run is not None and made(of_run.names) == made(names):
        return of_run
    return describe(
        names.id,
        names.features,
        names.units,
        names.actions,
        max_episode_steps=names.max_episode_steps,
        kwargs=names.kwargs,
        wrappers=names.wrappers,
    )


def tell_of_another_plant(path: Path, of_tree: Names, spec: EnvironmentSpec) -> None:
    """Say in a line where a user's own dynamics are others than those that a tree was made for."""
    if of_tree.source and of_tree.id == spec.id and of_tree.source != spec.names.source:
        _logger.warning(
            "The file of %s has changed since %s was made; the tree is measured with the plant as it is now.",
            spec.id,
            path,
        )


def made(names: Names) -> tuple[str, str, tuple[str, ...], int]:
    """Return how an environment is made, in an order."""
    kwargs = json.dumps(names.kwargs, sort_keys=True)
    return names.id, kwargs, names.wrappers, names.max_episode_steps or 0
