"""One episode of a controller, from its seed to a film or a window."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.play.episode import Moment, Which, chosen_seed, frames_per_second, moments
from ge_torchrl.play.film import check_film, stride_of, write_film
from ge_torchrl.play.frame import Stage, features_in_order
from ge_torchrl.play.ink import needs
from ge_torchrl.play.traces import Traces
from ge_torchrl.play.window import check_window, show
from ge_torchrl.report.tables import counted
from ge_torchrl.trees.controller import Controller

if TYPE_CHECKING:
    from PIL.Image import Image

# Of what an environment does not draw.
_TRACED_PER_SECOND = 25.0


@dataclass(frozen=True)
class Played:
    """What was shown.

    Attributes:
        path: The file; None where it was a window.
        environment: In words.
        seed: Of the episode.
        steps: Shown.
        total: Sum of the rewards.
        ended: Why it ended, in words.
        is_drawn: Whether the environment draws itself.
    """

    path: Path | None
    environment: str
    seed: int
    steps: int
    total: float
    ended: str
    is_drawn: bool

    def as_text(self) -> str:
        """Return the lines for a person."""
        told = (
            f"{self.environment}, seed {self.seed}: return {self.total:g} in {counted(self.steps, 'step')}, "
            f"{self.ended}"
        )
        if self.path is None:
            return told
        return f"{told}\nwrote {self.path} ({self.path.stat().st_size / 1e6:.1f} MB)"


def play(
    controller: Controller,
    spec: EnvironmentSpec,
    seed: int,
    path: Path | None = None,
    which: Which | None = None,
    most_steps: int = 1000,
) -> Played:
    """Show an episode as a film, or in a window.

    Args:
        controller: Decides.
        spec: The environment.
        seed: The episode is that of `reset(seed=seed)`, or chosen among those from there on.
        path: The file, a GIF or an MP4; None opens a window.
        which: Choose an episode by its return; None takes that of the seed.
        most_steps: So many steps at most.

    Raises:
        UserError: There is no display, a package is missing, the file cannot be written, or the environment failed.
    """
    needs("PIL", "pillow", "playing")
    if path is None:
        check_window()
    else:
        check_film(path)
    per_second = frames_per_second(spec)
    if which is not None:
        seed = chosen_seed(controller.tree, spec, seed, which)
    # The first time for its length and for what is observed, the second time to be drawn.
    episode = list(moments(controller, spec, seed, most_steps, None))
    traces = None
    if per_second is None:
        seen = np.array([moment.observation for moment in episode])
        traces = Traces(controller.names, features_in_order(controller), seen)
    stage = Stage(controller, seed, traces)
    rate = per_second or _TRACED_PER_SECOND
    stride = 1 if path is None else stride_of(path, len(episode), rate)
    last: list[Moment] = []

    def frames() -> Iterator[Image | None]:
        shown = moments(
            controller, spec, seed, most_steps, None if traces else lambda step: step % stride == 0
        )
        for moment in shown:
            if moment.ended or moment.step % stride == 0:
                last[:] = [moment]
                yield stage.frame(moment)
            while path is None and moment.ended:
                # Were the environment closed now, some would take pygame's window with them.
                yield None

    if path is None:
        show(frames(), rate, f"{controller.names.environment}, seed {seed}")
    else:
        write_film(path, filter(None, frames()), rate / stride)
    (end,) = last
    return Played(
        path,
        controller.names.environment,
        seed,
        end.step,
        end.total,
        end.ended or "stopped",
        is_drawn=traces is None,
    )
