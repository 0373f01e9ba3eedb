"""Frames as a file: GIF by Pillow, MP4 by the ffmpeg that imageio-ffmpeg brings along."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import chain, repeat
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from ge_torchrl.artefacts.texts import told_of, write_whole
from ge_torchrl.errors import UserError
from ge_torchrl.play.ink import COLOURS, needs

if TYPE_CHECKING:
    from PIL.Image import Image

_LAST_SECONDS = 1.5
# Browsers show no GIF faster, and more frames make one too large to send around.
_GIF_FRAMES_PER_SECOND, _GIF_FRAMES = 25.0, 250
_COLOURS = 96
_COMMON_FRAMES = 4


def stride_of(path: Path, n_states: int, frames_per_second: float) -> int:
    """Return every how manieth state of an episode a file shows, so that it lasts as long as the episode.

    Args:
        path: Of the file.
        n_states: Of the episode.
        frames_per_second: States a second.
    """
    if path.suffix.lower() != ".gif":
        return 1
    return max(1, math.ceil(frames_per_second / _GIF_FRAMES_PER_SECOND), math.ceil(n_states / _GIF_FRAMES))


def check_film(path: Path) -> None:
    """Refuse a name of a file that is neither a GIF nor an MP4, or that cannot be written, and make its folder.

    Raises:
        UserError: It is refused, or a package is not installed.
    """
    if path.suffix.lower() not in _WRITERS:
        raise UserError(f"--out must be a file whose name ends in .gif or .mp4; got {path}")
    if path.suffix.lower() == ".mp4":
        needs("imageio_ffmpeg", "imageio-ffmpeg", "an MP4")
    with told_of(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)


def write_film(path: Path, frames: Iterator[Image], frames_per_second: float) -> None:
    """Write frames as a film; the last one stays for a while.

    Args:
        path: Of the file; its ending says what it becomes.
        frames: All of one size, at least one.
        frames_per_second: Of the film.

    Raises:
        ArtefactError: The file cannot be written.
    """
    writer = _WRITERS[path.suffix.lower()]

    def write(beside: Path) -> None:
        try:
            writer(beside, frames, frames_per_second)
        except BaseException:
            beside.unlink(missing_ok=True)
            raise

    write_whole(path, write)


def _write_gif(path: Path, frames: Iterator[Image], frames_per_second: float) -> None:
    from PIL.Image import Dither

    held = _Held(frames)
    palette = _palette(held)
    few = (frame.quantize(palette=palette, dither=Dither.NONE) for frame in held)
    # GIF counts hundredths of a second.
    each = 10 * round(100 / frames_per_second)
    next(few).save(
        path,
        "GIF",
        save_all=True,
        append_images=few,
        duration=[*repeat(each, len(held) - 1), round(1000 * _LAST_SECONDS)],
        loop=0,
        disposal=1,
        optimize=True,  # What did not change is left transparent.
    )


class _Held:
    """Frames in memory, compressed: they are needed twice, and hundreds of them would take a gigabyte."""

    def __init__(self, frames: Iterable[Image]) -> None:
        self.size = (0, 0)
        self._packed: list[bytes] = []
        for frame in frames:
            self.size = frame.size
            self._packed.append(zlib.compress(frame.tobytes(), 1))

    def __len__(self) -> int:
        return len(self._packed)

    def __getitem__(self, place: int) -> Image:
        from PIL import Image

        return Image.frombytes("RGB", self.size, zlib.decompress(self._packed[place]))

    def __iter__(self) -> Iterator[Image]:
        return map(self.__getitem__, range(len(self)))


def _palette(frames: _Held) -> Image:
    """Return a palette for all frames: then what does not move stays the same to the bit, and takes no space.

    The colours of the rule are in it as they are.
    """
    from PIL import Image, ImageColor

    chosen = range(0, len(frames), max(1, len(frames) // _COMMON_FRAMES))
    width, height = frames.size
    together = Image.new("RGB", (width, height * len(chosen)))
    for i, place in enumerate(chosen):
        together.paste(frames[place], (0, i * height))
    ours = [ImageColor.getrgb(colour) for colour in COLOURS]
    found = together.quantize(_COLOURS, dither=Image.Dither.NONE).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette([*chain.from_iterable(ours), *found])
    return palette


def _write_mp4(path: Path, frames: Iterator[Image], frames_per_second: float) -> None:
    import imageio_ffmpeg

    first = next(frames)
    writer = imageio_ffmpeg.write_frames(
        str(path),
        first.size,
        fps=frames_per_second,
        quality=7,
        macro_block_size=2,
        output_params=["-f", "mp4", "-movflags", "+faststart"],
    )
    writer.send(None)
    last = first
    try:
        for frame in chain([first], frames):
            writer.send(frame.tobytes())
            last = frame
        for _ in range(round(_LAST_SECONDS * frames_per_second)):
            writer.send(last.tobytes())
    finally:
        writer.close()


_WRITERS: Mapping[str, Callable[[Path, Iterator[Image], float], None]] = MappingProxyType(
    {".gif": _write_gif, ".mp4": _write_mp4}
)
