"""Checkpoints: where a run stands between two generations, as files that execute nothing when they are read.

A file is one line of text, with the SHA-256 of all that follows, and then a `.npz` of plain arrays. One of them,
`plain`, is JSON. The last two files are kept: the last one may be damaged, or younger than what it counts on.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.artefacts.lines import Mark
from ge_torchrl.artefacts.texts import told_of, write_bytes
from ge_torchrl.errors import ArtefactError, UserError
from ge_torchrl.reading import read_bytes
from ge_torchrl.search.saving import Packed, pack, unpack
from ge_torchrl.search.state import SearchState
from ge_torchrl.trees.controller import Names
from ge_torchrl.version import __version__

CHECKPOINTS = "checkpoints"
"""The folder of them within a run's folder."""
FORMAT = "ge_torchrl.checkpoint/1"

_KEPT = 2
_NOTHING = "it holds none, nor the summary.json of a run that is finished"
_PLAIN = "plain"
# What comes of bytes that somebody else has made.
_FAULTS = (
    UserError, AttributeError, EOFError, LookupError, MemoryError, NotImplementedError, OSError, OverflowError,
    RecursionError, TypeError, ValueError, zipfile.BadZipFile,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """Where a run stands after a generation: all that the rest of it depends on, beside its configuration.

    Attributes:
        state: The state of the search.
        steps: Environment steps by purpose.
        asked: Digests of trees that validation was asked of, whether they solve the task.
        outside: A value of each feature that was seen outside its declared bounds.
        is_endless: Whether an episode was ended by the run, because the environment sets no limit.
        warnings: What the user was warned of.
        stopped_by: What ended the search; None while it goes on.
        concluded: Which parts of the conclusion are in the state already.
        improved: Trees that the refiner bettered.
        seconds: Clock time of the run [s].
        refine_seconds: Clock time of the refiner [s].
        polish_seconds: Clock time of the polish [s].
        lines: How far each file of lines was written, by its name.
        config: The text of the configuration's file; who writes it puts it in.
    """

    state: SearchState
    steps: Mapping[str, int]
    asked: frozenset[bytes]
    outside: Mapping[int, float]
    is_endless: bool
    warnings: tuple[str, ...]
    stopped_by: str | None
    concluded: tuple[str, ...]
    improved: int
    seconds: float
    refine_seconds: float
    polish_seconds: float
    lines: Mapping[str, Mark]
    config: str = ""


def write_checkpoint(run: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint into the folder of a run, and remove those that are no longer needed.

    Raises:
        ArtefactError: It cannot be written; the one before is still there.
    """
    folder = run / CHECKPOINTS
    with told_of(folder):
        folder.mkdir(exist_ok=True)
    content = _content(checkpoint)
    head = f"{FORMAT} {__version__} {hashlib.sha256(content).hexdigest()}\n"
    write_bytes(_path(folder, checkpoint.state.generation), head.encode() + content)
    for path in _files(folder)[_KEPT:]:
        with told_of(path):
            path.unlink(missing_ok=True)


def sound_checkpoint(run: Path, names: Names, told: Callable[[str], None]) -> Checkpoint:
    """Return the last checkpoint of a run that is whole, and whose lines of records are there.

    Args:
        run: The run's folder.
        names: Of its environment.
        told: Is told of each one that is passed over, in a line.

    Raises:
        ArtefactError: There is none; the message says what is wrong with the last one.
    """
    faults = []
    for path in _files(run / CHECKPOINTS):
        try:
            checkpoint = _checkpoint(path, names)
            _check_lines(run, checkpoint)
        except ArtefactError as error:
            faults.append(str(error))
            continue
        for fault in faults:
            told(f"{fault}; the run goes on from {path.name}")
        return checkpoint
    raise ArtefactError(f"{run} must hold a checkpoint to go on from; {faults[0] if faults else _NOTHING}")


def has_checkpoint(run: Path) -> bool:
    """Tell whether a run's folder holds a checkpoint, whole or not."""
    return bool(_files(run / CHECKPOINTS))


def config_of_checkpoints(run: Path) -> str | None:
    """Return the text of the configuration that checkpoints of a run were made with; None where none can be read."""
    for path in _files(run / CHECKPOINTS):
        with suppress(ArtefactError):
            return str(_content_of(path)[0]["config"])
    return None


def remove_checkpoints(run: Path) -> None:
    """Remove all checkpoints of a run that has come to its end.

    Raises:
        ArtefactError: They cannot be removed.
    """
    folder = run / CHECKPOINTS
    with told_of(folder):
        if folder.is_dir():
            for path in folder.iterdir():
                path.unlink()
            folder.rmdir()


def has_checkpoints(run: Path) -> bool:
    """Tell whether there are checkpoints of a run."""
    return bool(_files(run / CHECKPOINTS))


def _path(folder: Path, generation: int) -> Path:
    return folder / f"{generation:08}.checkpoint"


def _files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.checkpoint"), reverse=True)


def _content(checkpoint: Checkpoint) -> bytes:
    packed = pack(checkpoint.state)
    told = {key: value for key, value in vars(checkpoint).items() if key != "state"}
    told |= {
        "asked": [digest.hex() for digest in checkpoint.asked],
        "outside": list(checkpoint.outside.items()),
        "steps": dict(checkpoint.steps),
        "state": packed.plain,
    }
    plain = np.frombuffer(json.dumps(told).encode(), np.uint8)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, array in {_PLAIN: plain, **packed.arrays}.items():
            with archive.open(f"{name}.npy", "w") as file:
                np.lib.format.write_array(file, array, allow_pickle=False)
    return buffer.getvalue()


def _check_lines(run: Path, checkpoint: Checkpoint) -> None:
    for name, mark in checkpoint.lines.items():
        if not mark.holds(run / name):
            raise ArtefactError(
                f"{run / name} must begin with the {mark.size} bytes that the run wrote until generation "
                f"{checkpoint.state.generation}; it is damaged, or a part of it is gone"
            )


def _content_of(path: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return what a checkpoint's file holds: what JSON says, and the arrays."""
    head, _, content = read_bytes(path).partition(b"\n")
    try:
        kind, version, digest = head.decode().split(" ")
    except ValueError as error:
        raise ArtefactError(f"{path} is damaged: it does not begin as a checkpoint does") from error
    if digest != hashlib.sha256(content).hexdigest():
        raise ArtefactError(f"{path} is damaged: its SHA-256 is not the one that it was written with")
    if (kind, version) != (FORMAT, __version__):
        raise ArtefactError(
            f"{path} must be a {FORMAT} of ge_torchrl {__version__}, because another version may go on in another way; "
            f"it is a {kind} of {version}"
        )
    try:
        arrays = _arrays(content)
        return json.loads(arrays.pop(_PLAIN).tobytes()), arrays
    except _FAULTS as error:
        raise ArtefactError(f"{path} is no checkpoint: {' '.join(str(error).split())}") from error


def _arrays(content: bytes) -> dict[str, NDArray[Any]]:
    arrays = {}
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        for entry in archive.infolist():
            # What is packed may be larger than any memory.
            if entry.compress_type != zipfile.ZIP_STORED:
                raise ValueError(f"{entry.filename} is compressed")
            with archive.open(entry) as file:
                arrays[entry.filename.removesuffix(".npy")] = np.lib.format.read_array(
                    file, allow_pickle=False
                )
    return arrays


def _checkpoint(path: Path, names: Names) -> Checkpoint:
    told, arrays = _content_of(path)
    try:
        state = unpack(Packed(told.pop("state"), arrays), names)
        return Checkpoint(state=state, **_plain(told))
    except _FAULTS as error:
        raise ArtefactError(f"{path} is no checkpoint: {' '.join(str(error).split())}") from error


def _plain(told: dict[str, Any]) -> dict[str, Any]:
    return {
        **told,
        "asked": frozenset(map(bytes.fromhex, told["asked"])),
        "outside": {int(feature): float(value) for feature, value in told["outside"]},
        "warnings": tuple(told["warnings"]),
        "concluded": tuple(told["concluded"]),
        "lines": {name: Mark(*mark) for name, mark in told["lines"].items()},
    }
