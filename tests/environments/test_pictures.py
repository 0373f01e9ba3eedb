"""Pictures of a recorded episode: of that episode, few, small, and only where it can be drawn without a screen."""

import zlib

import numpy as np
import pytest
from environments_for_tests import WalkEnv
from walks_for_tests import registered

from ge_torchrl.environments.backend import Ledger
from ge_torchrl.environments.gymnasium_backend import GymnasiumBackend
from ge_torchrl.environments.pictures import pictures_of, png_of
from ge_torchrl.environments.spec import describe
from ge_torchrl.trees.tree import DecisionTree


class DrawnWalk(WalkEnv):
    """Its picture tells how many steps it made."""

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012

    def __init__(self, render_mode=None, spoilt=False):
        super().__init__()
        self.render_mode, self._spoilt, self._made = render_mode, spoilt, 0

    def reset(self, *, seed=None, options=None):
        self._made = 0
        return super().reset(seed=seed, options=options)

    def step(self, action):
        self._made += 1
        observation, reward, *rest = super().step(action)
        return observation, reward + (self._spoilt and self.render_mode is not None), *rest

    def render(self):
        return np.full((41, 500, 3), self._made, np.uint8)


def drawn(env, **kwargs):
    spec = describe(env["id"], kwargs=kwargs)
    backend, ledger = GymnasiumBackend(spec), Ledger()
    trajectory = backend.record(DecisionTree.leaf(1), 3)
    backend.close()
    return trajectory, pictures_of(spec, trajectory, 3, ledger, "record"), ledger


def read(png):
    """Return the picture of our own PNG."""
    width, height = (int.from_bytes(png[start : start + 4], "big") for start in (16, 20))
    length = int.from_bytes(png[33:37], "big")
    rows = np.frombuffer(zlib.decompress(png[41 : 41 + length]), np.uint8).reshape(height, 1 + 3 * width)
    assert not rows[:, 0].any()
    return rows[:, 1:].reshape(height, width, 3)


def test_pictures_are_those_of_the_steps_that_they_name():
    with registered(DrawnWalk, max_episode_steps=60) as env:
        trajectory, pictures, ledger = drawn(env)
    steps = [step for step, _ in pictures]
    assert (steps[0], steps[-1]) == (0, len(trajectory.rewards))
    assert len(steps) <= 25
    assert ledger.steps["record"] == len(trajectory.rewards)
    for step, png in pictures:
        picture = read(png)
        assert picture.shape == (13, 166, 3)
        assert set(picture.ravel().tolist()) == {step}


def test_an_episode_that_goes_otherwise_while_it_is_drawn_has_none():
    with registered(DrawnWalk, max_episode_steps=60) as env:
        assert drawn(env, spoilt=True)[1] == []


def test_an_environment_without_pictures_has_none():
    with registered(WalkEnv, max_episode_steps=60) as env, pytest.raises(Exception, match="render_mode"):
        drawn(env)


def test_a_png_is_read_by_others(tmp_path):
    image = pytest.importorskip("PIL.Image")
    picture = np.random.default_rng(0).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    (tmp_path / "a.png").write_bytes(png_of(picture))
    with image.open(tmp_path / "a.png") as opened:
        np.testing.assert_array_equal(np.asarray(opened), picture)


def test_an_environment_of_gymnasium_is_drawn_without_a_screen():
    pytest.importorskip("pygame")
    _, pictures, _ = drawn({"id": "CartPole-v1"})
    assert len({png for _, png in pictures}) > 3
