"""Reading a tree from disk, with the environment that it is measured in."""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from pathlib import Path

from ge_torchrl.artefacts.controllers import named_controller, run_of
from ge_torchrl.artefacts.folder import CONFIG, RunFolder
from ge_torchrl.config import EnvironmentConfig
from ge_torchrl.environments.plants.plant import names_plant
from ge_torchrl.environments.spec import EnvironmentSpec, describe, describe_settings
from ge_torchrl.environments.trust import check_trusted
from ge_torchrl.errors import ArtefactError
from ge_torchrl.reading import is_folder, is_there
from ge_torchrl.trees.controller import Controller, Names, check_names
from ge_torchrl.trees.tree import DecisionTree

_logger = logging.getLogger(__name__)


def read_tree(path: Path, nodes: int | None) -> tuple[DecisionTree, EnvironmentSpec]:
    """Return a tree and the environment that it is measured in.

    Args:
        path: A tree's file, or a run's folder, whose champion is taken in the run's own environment.
        nodes: Take the tree with so many decision nodes from the archive of the run; None takes the champion.

    Raises:
        UserError: There is no such tree, its environment is at fault, or is code that nobody vouches for.
    """
    controller = named_controller(path, nodes)
    if is_folder(path):
        return controller.tree, environment_of_run(RunFolder(path), controller)
    run = run_of(path)
    env = RunFolder(run).read_config().env if is_there(run / CONFIG) else None
    return controller.tree, environment_of_tree(controller, env, path)


def environment_of_run(folder: RunFolder, controller: Controller) -> EnvironmentSpec:
    """Describe the environment of a run, in which one of its trees is measured.

    Raises:
        UserError: The run's configuration cannot be read, the environment is at fault, or it has changed so that the
            tree does not fit it.
    """
    env = folder.read_config().env
    check_trusted(env.id, env.wrappers, folder.path)
    check_trusted(controller.names.id, controller.names.wrappers, folder.path)
    _check_plant(controller.names, env)
    spec = describe_settings(env)
    _check_fit(controller, spec)
    _tell_of_another_plant(folder.path, controller.names, spec)
    return spec


def environment_of_tree(
    controller: Controller, of_run: EnvironmentConfig | None = None, source: Path | str = "the tree"
) -> EnvironmentSpec:
    """Describe the environment that a tree itself names, wherever it lies.

    Args:
        controller: The tree with its names.
        of_run: The environment of its run, which may know a threshold.
        source: The tree's name in warnings.

    Raises:
        UserError: The environment is at fault, or has changed so that the tree does not fit it.
    """
    names = controller.names
    check_trusted(names.id, names.wrappers, source)
    if of_run is not None:
        check_trusted(of_run.id, of_run.wrappers, source)
    _check_plant(names, of_run)
    spec = None if of_run is None else describe_settings(of_run)
    if spec is None or made(spec.names) != made(names):
        spec = describe(
            names.id,
            names.features,
            names.units,
            names.actions,
            max_episode_steps=names.max_episode_steps,
            kwargs=names.kwargs,
            wrappers=names.wrappers,
        )
    _check_fit(controller, spec)
    _tell_of_another_plant(source, names, spec)
    return spec


def _check_plant(of_tree: Names, env: EnvironmentConfig | None) -> None:
    """Refuse a user's own dynamics whose names are others by now, or in another order, than a tree has them.

    Names that the settings give are the user's own, and nobody can say what became of them.
    """
    if not names_plant(of_tree.id):
        return
    now = describe(of_tree.id, kwargs=of_tree.kwargs, wrappers=of_tree.wrappers).names
    if now.source == of_tree.source:
        return
    for key, reads, observes in (("features", "reads", "observes"), ("actions", "answers with", "takes")):
        names, there = getattr(of_tree, key), getattr(now, key)
        is_named_anew = env is not None and getattr(env, key) and set(names) != set(there)
        # Bins of a continuous action were mere numbers once.
        is_numbered = names == tuple(f"a{i}" for i in range(len(there)))
        if names != there and not is_named_anew and not is_numbered:
            raise ArtefactError(
                f"the tree {reads} {', '.join(names)}; {of_tree.id} {observes} {', '.join(there)}, because its file "
                "has changed since the tree was made"
            )


def _check_fit(controller: Controller, spec: EnvironmentSpec) -> None:
    """Refuse an environment that observes or takes something of another kind than a tree's."""
    names, has_actions = controller.names, controller.tree.has_actions
    if has_actions == spec.is_continuous:
        raise ArtefactError(
            f"the tree answers with {_kind(names.actions, is_continuous=not has_actions)}; {spec.id} takes "
            f"{_kind(spec.names.actions, is_continuous=spec.is_continuous)} by now"
        )
    check_names(controller.tree, spec.names)


def _kind(actions: Sequence[str], *, is_continuous: bool) -> str:
    return f"{'numbers for' if is_continuous else 'one of'} {', '.join(actions)}"


def _tell_of_another_plant(source: Path | str, of_tree: Names, spec: EnvironmentSpec) -> None:
    """Say in a line where a user's own dynamics are others than those that a tree was made for."""
    if of_tree.source and of_tree.id == spec.id and of_tree.source != spec.names.source:
        _logger.warning(
            "The file of %s has changed since %s was made; the tree is measured with the plant as it is now.",
            spec.id,
            source,
        )


def made(names: Names) -> tuple[str, str, tuple[str, ...], int]:
    """Return how an environment is made, in an order."""
    kwargs = json.dumps(names.kwargs, sort_keys=True)
    return names.id, kwargs, names.wrappers, names.max_episode_steps or 0
