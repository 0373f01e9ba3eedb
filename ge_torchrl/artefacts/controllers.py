"""One way to name a controller: by its file, or by the folder of the run that found it."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from ge_torchrl.artefacts.folder import ARCHIVE_TREES, BEST_TREE, SUMMARY, RunFolder
from ge_torchrl.artefacts.lines import read_sums
from ge_torchrl.artefacts.looking import check_run
from ge_torchrl.errors import ArtefactError
from ge_torchrl.reading import is_folder, is_there, name_of
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.files import read_controller


def named_controller(path: Path, nodes: int | None, key: str = "--nodes") -> Controller:
    """Return the controller that a path names.

    Args:
        path: A tree's file, or a run's folder, whose champion is meant.
        nodes: The tree with so many decision nodes from the archive of the run; None: the champion.
        key: What the user calls that number.

    Raises:
        UserError: There is no such tree.
    """
    if not is_there(path):
        raise ArtefactError(f"expected a tree's file or a run's folder; there is none at {name_of(path)}")
    if is_folder(path):
        check_run(path, BEST_TREE, SUMMARY)
        folder = RunFolder(path)
        return folder.read_best_tree() if nodes is None else folder.read_archive_tree(nodes)
    if nodes is not None:
        raise ArtefactError(f"{key} chooses a tree of a run, so expected a run's folder; got {path}")
    _check_in_run(path)
    return read_controller(path)


def run_of(path: Path) -> Path:
    """Return the folder of the run to which the file of a tree would belong, if it lies in one."""
    return path.parent.parent if path.parent.name == ARCHIVE_TREES else path.parent


def _check_in_run(path: Path) -> None:
    """Refuse a tree in the folder of a finished run that is not what the run wrote there."""
    run = run_of(path)
    name = path.relative_to(run).as_posix()
    listed = False
    # Another program's summary lists nothing of ours, and a damaged one nothing that can be trusted.
    with suppress(ArtefactError):
        listed = name in read_sums(run / SUMMARY)
    if listed:
        RunFolder(run).checked(name)
