"""A tree of somebody else's names code; it runs only where the user says so, or has run it before."""

import json
import sys

import gymnasium
import pytest
from hostile_trees import sound_document

from ge_torchrl.__main__ import main
from ge_torchrl.config.composing import compose
from ge_torchrl.environments.trust import check_trusted, remember, trusting
from ge_torchrl.errors import ArtefactError
from ge_torchrl.report.reading import read_tree
from ge_torchrl.run.plan import plan

MODULE = """
import pathlib
import gymnasium

pathlib.Path({mark!r}).touch()
gymnasium.register("Downloaded-v0", "gymnasium.envs.classic_control:CartPoleEnv", max_episode_steps=10)

class Wrapper(gymnasium.Wrapper):
    pass
"""
PLANT = """
import pathlib

pathlib.Path({mark!r}).touch()

class Cart:
    features = ("x", "x_dot", "theta", "theta_dot")
    actions = ("left", "right")
    start = [(0.0, 1.0)] * 4
    max_episode_steps = 3

    def step(state, action):
        return state, 1.0, False
"""


@pytest.fixture
def mark(tmp_path, monkeypatch):
    """The file that is made when code of somebody else's runs."""
    mark = tmp_path / "it_ran"
    (tmp_path / "downloaded_module.py").write_text(MODULE.format(mark=str(mark)))
    (tmp_path / "downloaded_plant.py").write_text(PLANT.format(mark=str(mark)))
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    yield mark
    forget()


def forget():
    """Unload the module, as another process would begin."""
    sys.modules.pop("downloaded_module", None)
    gymnasium.registry.pop("Downloaded-v0", None)


def written(path, **environment):
    document = sound_document()
    document["environment"] |= environment
    path.write_text(json.dumps(document))
    return path


NAMED = [
    {"id": "downloaded_module:Downloaded-v0"},
    {"wrappers": ["downloaded_module:Wrapper"]},
    {"id": "downloaded_plant.py:Cart", "units": ["", "", "", ""]},
]


@pytest.mark.parametrize("environment", NAMED)
def test_code_that_a_tree_names_does_not_run_unless_the_user_says_so(environment, mark, tmp_path, capsys):
    tree = written(tmp_path / "tree.json", **environment)
    for verb in ("evaluate", "play"):
        assert main([verb, str(tree)]) == 2
        assert "tree.json names code that would run here, downloaded_" in capsys.readouterr().err
    assert not mark.exists()
    with trusting():
        read_tree(tree, None)
    assert mark.exists()


def test_evaluate_trusts_where_it_is_told_to(mark, tmp_path, capsys):
    tree = written(tmp_path / "tree.json", id="downloaded_module:Downloaded-v0")
    assert main(["evaluate", str(tree), "--episodes", "2", "--trust"]) == 0
    assert mark.exists()
    assert "mean return" in capsys.readouterr().out


def test_what_a_run_of_the_users_has_run_needs_no_word(mark, tmp_path):
    plan(compose("downloaded_module:Downloaded-v0", {}, {}))
    assert mark.exists()
    forget()
    read_tree(written(tmp_path / "tree.json", id="downloaded_module:Downloaded-v0"), None)


@pytest.mark.usefixtures("mark")
def test_the_same_name_in_another_place_is_other_code(tmp_path, monkeypatch):
    plan(compose("downloaded_module:Downloaded-v0", {}, {}))
    forget()
    other = tmp_path / "other"
    other.mkdir()
    (other / "downloaded_module.py").write_text("raise RuntimeError")
    monkeypatch.syspath_prepend(str(other))
    with pytest.raises(ArtefactError, match="downloaded_module, and no run of yours"):
        read_tree(written(tmp_path / "tree.json", id="downloaded_module:Downloaded-v0"), None)


@pytest.mark.parametrize(
    ("environment_id", "wrappers"),
    [
        ("CartPole-v1", ()),
        ("gymnasium.envs.classic_control:CartPole-v1", ["gymnasium.wrappers:ClipReward {min_reward: 0}"]),
        ("CartPole-v1", ["ge_torchrl.environments.wrappers:OneChoice"]),
        (
            "CartPole-v1",
            ["gymnasium.wrappers:FlattenObservation", "gymnasium.wrappers:TimeLimit {max_episode_steps: 9}"],
        ),
    ],
)
def test_gymnasium_and_this_package_need_no_word(environment_id, wrappers):
    check_trusted(environment_id, wrappers, "a tree")


@pytest.mark.parametrize(
    "wrapper",
    [
        "gymnasium.wrappers:RecordVideo {video_folder: videos}",
        "gymnasium.wrappers.rendering:RecordVideo {video_folder: videos}",
        "gymnasium.wrappers:HumanRendering",
        "gymnasium.wrappers:OfALaterVersion",
        "gymnasium.utils.play:Player",
    ],
)
def test_wrappers_of_gymnasiums_that_write_or_open_something_need_a_word(wrapper, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    with pytest.raises(
        ArtefactError, match=rf"names code that would run here, {wrapper.partition(' ')[0]}, .*--trust"
    ):
        check_trusted("CartPole-v1", ["gymnasium.wrappers:ClipAction", wrapper], "a tree")
    with trusting():
        check_trusted("CartPole-v1", [wrapper], "a tree")
    remember("CartPole-v1", [wrapper])
    check_trusted("CartPole-v1", [wrapper], "a tree")
    if " " in wrapper:
        with pytest.raises(ArtefactError):
            check_trusted("CartPole-v1", [wrapper.replace("videos", "/etc")], "a tree")
