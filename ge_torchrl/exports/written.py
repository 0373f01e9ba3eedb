"""An export, before it is verified."""

from __future__ import annotations

from typing import NamedTuple

from ge_torchrl.trees.controller import Controller


class Written(NamedTuple):
    """A controller in some format.

    Attributes:
        controller: The controller.
        name: What it is called there.
        content: The bytes of the file.
    """

    controller: Controller
    name: str
    content: bytes
