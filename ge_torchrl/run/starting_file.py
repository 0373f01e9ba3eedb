"""The file of an environment that a user begins with: what a run would take, for editing."""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from ge_torchrl.environments.registry import registered_id
from ge_torchrl.errors import ArtefactError

if TYPE_CHECKING:
    from ge_torchrl.run.plan import Plan


def starting_name(environment_id: str, taken: Collection[str]) -> str:
    """Return what the choice of an environment is called: `lunarlander`, or `my_lunarlander` where that is taken."""
    bare = re.sub(r"-v\d+$", "", registered_id(environment_id))
    name = re.sub(r"\W+", "_", bare).strip("_").lower()
    return f"my_{name}" if name in taken else name


def starting_text(planned: Plan, folder: Path, name: str) -> str:
    """Return the file: environment, names and grammar of a plan.

    Args:
        planned: What would be run.
        folder: Where the file's group lies.
        name: What the choice is called.
    """
    spec, config = planned.spec, planned.config
    env: dict[str, Any] = {"dynamics": spec.id} if config.env.dynamics else {"id": spec.id}
    if config.env.kwargs:
        env["kwargs"] = dict(config.env.kwargs)
    if config.env.wrappers:
        env["wrappers"] = list(config.env.wrappers)
    env |= {
        "features": list(spec.names.features),
        "units": list(spec.names.units),
        "actions": list(spec.names.actions),
        "solved_at": spec.solved_at,
        "max_episode_steps": spec.max_episode_steps,
    }
    return "\n".join(
        [
            "# @package _global_",
            "# The first line has to stay. All else may be changed, and any other setting may follow. It is run by",
            f"#   {starting_command(folder, name)}",
            _dumped({"env": env}),
            "grammar: # A range for each feature, of the values that it takes in play. Without bnf it is made again.",
            f"  name: {name}",
            "  bnf: |",
            *(f"    {line}".rstrip() for line in (config.grammar.bnf or "").splitlines()),
            "",
        ]
    )


def starting_command(folder: Path, name: str) -> str:
    """Return the command that runs the file."""
    return f"python -m ge_torchrl --config-dir {shlex.quote(str(folder))} env={name}"


def write_starting_file(planned: Plan, folder: Path, name: str) -> Path:
    """Write the file, and return where it is.

    Raises:
        ArtefactError: There is one already, or it cannot be written.
    """
    path = folder / "env" / f"{name}.yaml"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8", newline="\n") as file:
            file.write(starting_text(planned, folder, name))
    except FileExistsError as error:
        raise ArtefactError(
            f"{path} is there already, and may have been edited; expected a new file"
        ) from error
    except OSError as error:
        raise ArtefactError(f"{path}: cannot write the file: {error.strerror}") from error
    return path


def _dumped(values: dict[str, Any]) -> str:
    # Innermost lists and mappings in one line each, as in conf/.
    return yaml.safe_dump(values, sort_keys=False, default_flow_style=None, width=100, allow_unicode=True)
