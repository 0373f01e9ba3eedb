"""`episodes.json`: float32 numbers come back as they were, and what is no such file is told in one line."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_numpy

from ge_torchrl.artefacts.episodes import Episode, Episodes, episodes_text, read_episodes
from ge_torchrl.errors import ArtefactError

FLOATS = st.floats(width=32, allow_infinity=False)


def episode(observations, actions, rewards, **changes):
    told = {
        "tree": "champion", "rank": "best", "seed": 7, "total": -1.5, "length": 9, "terminated": True,
        "truncated": False,
    }  # fmt: skip
    arrays = np.array(observations, np.float32), np.array(actions), np.array(rewards, np.float32)
    return Episode(**{**told, **changes}, observations=arrays[0], actions=arrays[1], rewards=arrays[2])


def there_and_back(path, recorded):
    episodes = Episodes(np.array([1.0, -0.1]), {"champion": np.array([3, 4])}, (recorded,))
    path.write_text(episodes_text(episodes), encoding="utf-8")
    return read_episodes(path)


@given(
    observations=st_numpy.arrays(np.float32, (3, 2), elements=FLOATS),
    values=st_numpy.arrays(np.float32, (2, 1), elements=FLOATS),
    rewards=st_numpy.arrays(np.float32, 2, elements=FLOATS),
)
def test_what_is_written_comes_back(tmp_path_factory, observations, values, rewards):
    path = tmp_path_factory.mktemp("episodes") / "episodes.json"
    for actions in (values, np.array([0, 12])):
        written = episode(observations, actions, rewards)
        read = there_and_back(path, written)
        (one,) = read.recorded
        for name in ("observations", "actions", "rewards"):
            np.testing.assert_array_equal(getattr(one, name), getattr(written, name))
        assert one.actions.dtype == (np.float32 if actions.ndim == 2 else np.int64)
        assert (one.tree, one.rank, one.seed, one.total, one.length) == ("champion", "best", 7, -1.5, 9)
        assert (one.terminated, one.truncated) == (True, False)
        assert read.returns.tolist() == [1.0, -0.1]
        assert read.visits["champion"].tolist() == [3, 4]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "holds no episodes"),
        ("[]", "holds no episodes"),
        ('{"format": "ge_torchrl.episodes/1"}', "holds no episodes: KeyError"),
        ('{"format": "another/1"}', "must be in the format"),
    ],
)
def test_another_file_is_told_in_one_line(tmp_path, text, told):
    path = tmp_path / "episodes.json"
    path.write_text(text)
    with pytest.raises(ArtefactError, match=told) as raised:
        read_episodes(path)
    assert "\n" not in str(raised.value)


def test_an_episode_of_unequal_lengths_is_refused(tmp_path):
    path = tmp_path / "episodes.json"
    there_and_back(path, episode([[0.0], [1.0]], [0], [1.0]))
    content = json.loads(path.read_text())
    content["recorded"][0]["rewards"] = []
    path.write_text(json.dumps(content))
    with pytest.raises(ArtefactError, match="one observation more"):
        read_episodes(path)


def test_how_long_a_step_is_comes_back_where_it_is_known(tmp_path):
    for seconds in (None, 0.01):
        path = tmp_path / "episodes.json"
        path.write_text(episodes_text(Episodes(np.zeros(1), {}, (), seconds)))
        assert read_episodes(path).step_seconds == seconds
    path.write_text(path.read_text().replace("0.01", "-1"))
    with pytest.raises(ArtefactError, match="step_seconds must be a time above 0"):
        read_episodes(path)
