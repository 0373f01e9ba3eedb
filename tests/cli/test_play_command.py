"""`play`, as a user types it: on a machine without a display too."""

import os
import subprocess
import sys

import gymnasium as gym
import pytest
from documents_for_tests import CONTROLLER
from environments_for_tests import WalkEnv
from pages_for_tests import ROOT

from ge_torchrl.__main__ import main
from ge_torchrl.environments.spec import describe
from ge_torchrl.play import ink
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.files import write_controller
from ge_torchrl.trees.tree import DecisionTree

Image = pytest.importorskip("PIL.Image")


def test_a_film_needs_no_display(tmp_path):
    nowhere = {
        name: value
        for name, value in os.environ.items()
        if "DISPLAY" not in name and not name.startswith("SDL")
    }
    tree = ROOT / "docs" / "trees" / "cartpole_two_decisions.json"
    command = [
        sys.executable,
        "-m",
        "ge_torchrl",
        "play",
        str(tree),
        "--steps",
        "4",
        "--out",
        "a/episode.gif",
    ]
    done = subprocess.run(command, cwd=tmp_path, env=nowhere, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    told, wrote = done.stdout.splitlines()
    assert told == "CartPole-v1, seed 10000: return 4 in 4 steps, shown up to step 4"
    assert wrote.startswith("wrote a/episode.gif (0.")
    with Image.open(tmp_path / "a" / "episode.gif") as film:
        assert film.size == (1280, 720)


@pytest.fixture
def tree_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    write_controller(tmp_path / "tree.json", CONTROLLER)
    return "tree.json"


def test_what_draws_no_picture_is_shown_by_what_it_observes(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    gym.register("DrawsNothing-v1", WalkEnv, max_episode_steps=20)
    try:
        names = describe("DrawsNothing-v1").names
        write_controller(tmp_path / "walk.json", Controller(DecisionTree.leaf(0), names))
        assert main(["play", "walk.json", "--out", "walk.gif", "--episode", "worst"]) == 0
    finally:
        del gym.registry["DrawsNothing-v1"]
    printed = capsys.readouterr()
    assert (
        printed.err == "ge-torchrl: DrawsNothing-v1 draws no picture of itself; what it observes is drawn\n"
    )
    assert printed.out.startswith("DrawsNothing-v1, seed 10")
    assert (tmp_path / "walk.gif").exists()


@pytest.mark.skipif(sys.platform in ("darwin", "win32"), reason="always has a display")
@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ([], "no display is there for a window; expected a file to write, as in --out episode.gif"),
        (["--out", "a.avi"], "--out must be a file whose name ends in .gif or .mp4; got a.avi"),
        (["--nodes", "3", "--out", "a.gif"], "--nodes chooses a tree of a run"),
        (["--episode", "odd"], "argument --episode: invalid choice"),
    ],
)
def test_mistakes_are_told_in_one_line(tree_file, capsys, arguments, told):
    assert main(["play", tree_file, *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"ge-torchrl: {told}")
    assert error.count("\n") == 1


def test_what_is_missing_is_told_with_what_to_install(tree_file, monkeypatch, capsys):
    monkeypatch.setattr(ink, "find_spec", lambda _: None)
    assert main(["play", tree_file, "--out", "a.gif"]) == 2
    assert capsys.readouterr().err == (
        'ge-torchrl: playing needs pillow; expected it installed: pip install -c constraints.txt -e ".[play]"\n'
    )
