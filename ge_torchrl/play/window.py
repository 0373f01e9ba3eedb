"""Frames in a window, as they are made."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from ge_torchrl.errors import UserError
from ge_torchrl.play.frame import SIZE
from ge_torchrl.play.ink import needs

if TYPE_CHECKING:
    from PIL.Image import Image


def check_window() -> None:
    """Refuse to open a window where there is no display.

    Raises:
        UserError: There is none, or a package is not installed.
    """
    has_display = sys.platform in ("darwin", "win32") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )
    if not has_display:
        raise UserError("no display is there for a window; expected a file to write, as in --out episode.gif")
    needs("pygame", "pygame-ce", "a window")


def show(frames: Iterator[Image | None], frames_per_second: float, title: str) -> None:
    """Show frames; space holds them, Escape, q or closing the window ends all, and the last frame stays.

    Args:
        frames: Of the size of a frame; None leaves the one before.
        frames_per_second: How many are shown a second.
        title: Of the window.

    Raises:
        UserError: The window cannot be opened.
    """
    import pygame

    try:
        try:
            pygame.display.init()
            window = pygame.display.set_mode(SIZE)
        except pygame.error as error:
            raise UserError(
                f"the window cannot be opened ({error}); expected a display, or a file to write, as in "
                "--out episode.gif"
            ) from error
        pygame.display.set_caption(title)
        _shown(pygame, window, frames, frames_per_second)
    finally:
        pygame.display.quit()


def _shown(pygame: Any, window: Any, frames: Iterator[Image | None], frames_per_second: float) -> None:
    clock = pygame.time.Clock()
    is_held = False
    while True:
        for event in pygame.event.get():
            key = event.key if event.type == pygame.KEYDOWN else None
            if event.type == pygame.QUIT or key in (pygame.K_ESCAPE, pygame.K_q):
                return
            is_held ^= key == pygame.K_SPACE
        if not is_held and (frame := next(frames, None)) is not None:
            window.blit(pygame.image.frombuffer(frame.tobytes(), SIZE, "RGB"), (0, 0))
        pygame.display.flip()
        clock.tick(frames_per_second)
