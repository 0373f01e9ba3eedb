"""The tree's own file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

from ge_torchrl.exports.code import answers_of
from ge_torchrl.exports.written import Written
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.files import from_json, to_json
from ge_torchrl.trees.tree import FloatArray


def write(controller: Controller, name: str) -> bytes:  # noqa: ARG001 - a tree has no name.
    """Return the text in the format `ge_torchrl.tree/2`.

    Args:
        controller: The controller.
        name: Not used.
    """
    return to_json(controller).encode()


def answers(written: Sequence[Written], observed: Sequence[FloatArray]) -> list[NDArray[Any]]:
    """Return what the trees, read again, answer to [B, D] observations of each."""
    return [
        answers_of(from_json(one.content.decode()), rows) for one, rows in zip(written, observed, strict=True)
    ]
