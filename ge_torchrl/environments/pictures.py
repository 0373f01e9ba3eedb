"""Few small pictures of an episode that was recorded, where an environment can be drawn without a screen."""

from __future__ import annotations

import os
import struct
import sys
import warnings
import zlib
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.backend import Ledger, Trajectory
from ge_torchrl.environments.spec import EnvironmentSpec, make_gymnasium

_MOST_PICTURES, _WIDTH = 24, 200
_MOST_BYTES = 600_000
# They open a window of their own in native code, which ends the process where there is no screen.
_NATIVE = ("mujoco", "robotics")
_PNG = b"\x89PNG\r\n\x1a\n"


def pictures_of(
    spec: EnvironmentSpec, trajectory: Trajectory, seed: int, ledger: Ledger, purpose: str
) -> list[tuple[int, bytes]]:
    """Play a recorded episode again, drawn.

    Args:
        spec: The environment.
        trajectory: What was recorded.
        seed: That of the episode.
        ledger: Where the steps are counted.
        purpose: Under which they are counted.

    Returns:
        (step, PNG) in the order of steps; none where the environment cannot be drawn here, or plays otherwise
        while it is drawn.

    Raises:
        Exception: Whatever the environment raises.
    """
    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        environment: Any = make_gymnasium(spec, render_mode="rgb_array")
        with closing(environment):
            if not _can_be_drawn(environment):
                return []
            frames = list(_frames(environment, spec, trajectory, seed, ledger, purpose))
    if frames[-1][0] != len(trajectory.rewards):
        return []
    pictures = [(step, png_of(_small(frame))) for step, frame in frames]
    return pictures if sum(len(png) for _, png in pictures) <= _MOST_BYTES else []


def _can_be_drawn(environment: Any) -> bool:
    modes = environment.metadata.get("render_modes", ())
    module = type(environment.unwrapped).__module__
    return "rgb_array" in modes and not any(name in module for name in _NATIVE)


def _frames(
    environment: Any,
    spec: EnvironmentSpec,
    trajectory: Trajectory,
    seed: int,
    ledger: Ledger,
    purpose: str,
) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    n_steps = len(trajectory.rewards)
    shown = set(np.linspace(0, n_steps, _MOST_PICTURES).astype(int).tolist())
    environment.reset(seed=seed)
    yield 0, np.asarray(environment.render(), np.uint8)
    for step, action in enumerate(trajectory.actions):
        given = np.asarray(action, environment.action_space.dtype) if spec.is_continuous else int(action)
        _, reward, *_ = environment.step(given if spec.is_continuous else given + spec.first_action)
        ledger.count(purpose, 1)
        if float(reward) != trajectory.rewards[step]:
            return
        if step + 1 in shown:
            yield step + 1, np.asarray(environment.render(), np.uint8)


def _small(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture [H, W, 3] of at most `_WIDTH` columns: means of blocks."""
    block = max(1, -(-frame.shape[1] // _WIDTH))
    height, width = (side // block for side in frame.shape[:2])
    blocks = frame[: height * block, : width * block, :3].reshape(height, block, width, block, 3)
    small: NDArray[np.uint8] = blocks.mean(axis=(1, 3)).round().astype(np.uint8)
    return small


def png_of(picture: NDArray[np.uint8]) -> bytes:
    """Return a picture [H, W, 3] as PNG."""
    height, width, _ = picture.shape
    # Each row begins with its filter: none.
    rows = np.concatenate([np.zeros((height, 1), np.uint8), picture.reshape(height, -1)], axis=1)
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 9)), (b"IEND", b"")]
    return _PNG + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )
