"""Films: small, complete or not there at all, and as long as the episode."""

from pathlib import Path

import numpy as np
import pytest
from documents_for_tests import CONTROLLER
from PIL import Image
from stages_for_tests import moment_of

from ge_torchrl.errors import ArtefactError, UserError
from ge_torchrl.play import ink
from ge_torchrl.play.film import check_film, stride_of, write_film
from ge_torchrl.play.frame import Stage


def frames(n):
    """Frames in which only numbers change."""
    stage = Stage(CONTROLLER, 7, None)
    for i in range(n):
        observation = np.float32([0.1 * i, -0.02 * i, 0.01 * i, 0.0])
        yield stage.frame(moment_of(CONTROLLER, observation))


def test_a_gif_is_small_and_lasts_as_long_as_the_episode(tmp_path):
    path = tmp_path / "episode.gif"
    write_film(path, frames(20), 10)
    assert [found.name for found in tmp_path.iterdir()] == ["episode.gif"]
    # 3 MB for 200 frames, with room for the picture.
    assert path.stat().st_size < 150_000
    with Image.open(path) as shown:
        durations = []
        for i in range(shown.n_frames):
            shown.seek(i)
            durations.append(shown.info["duration"])
        assert shown.size == (1280, 720)
    assert sum(durations) == 19 * 100 + 1500


def test_an_mp4_holds_every_frame(tmp_path):
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "episode.mp4"
    write_film(path, frames(6), 4)
    assert [found.name for found in tmp_path.iterdir()] == ["episode.mp4"]
    n_frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(path))
    assert (n_frames, seconds) == (6 + 6, 3)


@pytest.mark.parametrize("name", ["episode.gif", "episode.mp4"])
def test_what_breaks_off_leaves_no_file(tmp_path, name):
    pytest.importorskip("imageio_ffmpeg")

    def breaking():
        yield from frames(2)
        raise ArtefactError("here")

    with pytest.raises(ArtefactError, match="here"):
        write_film(tmp_path / name, breaking(), 10)
    assert list(tmp_path.iterdir()) == []


def test_names_of_files_that_cannot_be_are_refused(tmp_path, monkeypatch):
    with pytest.raises(UserError, match=r"--out must be a file whose name ends in \.gif or \.mp4; got"):
        check_film(tmp_path / "episode.avi")
    (tmp_path / "file").write_text("")
    with pytest.raises(ArtefactError, match="cannot be written"):
        check_film(tmp_path / "file" / "episode.gif")
    check_film(tmp_path / "new" / "episode.gif")
    assert (tmp_path / "new").is_dir()
    monkeypatch.setattr(ink, "find_spec", lambda _: None)
    with pytest.raises(UserError, match=r'an MP4 needs imageio-ffmpeg; .* -e "\.\[play\]"'):
        check_film(tmp_path / "episode.mp4")


@pytest.mark.parametrize(
    ("name", "n_states", "per_second", "stride"),
    [
        ("a.gif", 501, 50, 3),
        ("a.gif", 100, 30, 2),
        ("a.GIF", 95, 15, 1),
        ("a.gif", 1001, 50, 5),
        ("a.mp4", 9999, 50, 1),
    ],
)
def test_a_gif_leaves_out_states_rather_than_grow(name, n_states, per_second, stride):
    assert stride_of(Path(name), n_states, per_second) == stride
