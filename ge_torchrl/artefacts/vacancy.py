"""Whether a run may leave its files in a folder: nothing of somebody else's is written over."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ge_torchrl.config import Config, without_gone
from ge_torchrl.errors import ArtefactError, UserError
from ge_torchrl.reading import MOST_SETTINGS_BYTES, is_there, read_text, yaml_of


def check_vacant(path: Path, names: Iterable[str], config: str, key: str) -> None:
    """Refuse a folder in which something has the name of a file that a run writes.

    Args:
        path: The folder; it need not exist.
        names: Of these files.
        config: Of the run's configuration; one that a run left which found nothing may be replaced.
        key: What the user calls the folder.

    Raises:
        ArtefactError: Something has such a name.
    """
    for name in names:
        if is_there(path / name) and not (name == config and _is_configuration(path / name)):
            raise ArtefactError(
                f"{key} must be a folder without a run, so that nothing is lost; {path} holds {name} already"
            )


def _is_configuration(path: Path) -> bool:
    try:
        Config.from_mapping(without_gone(yaml_of(read_text(path, MOST_SETTINGS_BYTES))))
    except (UserError, ValueError):
        return False
    return True
