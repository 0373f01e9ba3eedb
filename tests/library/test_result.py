import dataclasses

import pytest

import ge_torchrl as ge
from ge_torchrl.errors import ArtefactError


def test_controllers_are_found_by_their_decision_nodes(result):
    assert list(result.controllers) == [record.decision_nodes for record in result.sizes]
    assert result.controllers[result.champion.decision_nodes] is not None
    with pytest.raises(KeyError, match="no controller with 99 decision nodes; there are 0, 1"):
        result.controllers[99]
    assert repr(result.controllers).startswith("CartPole-v1, 0 decision nodes\nalways ")


def test_it_cannot_be_changed(result):
    with pytest.raises(dataclasses.FrozenInstanceError):
        result.champion = None
    with pytest.raises(TypeError):
        result.controllers[1] = None


def test_it_tells_in_a_terminal_and_in_a_notebook(result):
    text, markdown = repr(result), result._repr_markdown_()
    assert text.startswith("CartPole-v1, seed 1, GE: ")
    for told in (text, markdown):
        assert f"test mean {result.summary.test_mean:.2f} (95 % interval " in told
        assert "on 40 unseen episodes" in told
    assert "| decision nodes | test mean ± sd |" in markdown
    low, high = result.test_interval
    assert low <= result.summary.test_mean <= high


def test_a_run_without_an_archive_has_no_controllers(small):
    alone = ge.evolve("cartpole", refiner="none", archive="none", settings=small)
    assert (len(alone.controllers), alone.sizes) == (0, ())
    with pytest.raises(KeyError, match="the run kept none"):
        alone.controllers[3]
    assert repr(alone.controllers) == "no controllers: the run kept none"
    assert "decision nodes  test mean" not in repr(alone)


def test_a_folder_without_a_finished_run_is_told(tmp_path):
    with pytest.raises(
        ArtefactError, match=r"must be the folder of one run, which holds summary\.json; it holds no run"
    ):
        ge.load_run(tmp_path)
    with pytest.raises(ArtefactError, match=r"expected the folder of a run; .* is not there"):
        ge.load_run(tmp_path / "nowhere")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "config.yaml").write_text("seed: 1")
    with pytest.raises(
        ArtefactError, match=r"must have summary\.json; .* ge-torchrl resume .*run goes on with it"
    ):
        ge.load_run(tmp_path / "run")
    (tmp_path / "run" / "summary.json").write_text("{}")
    with pytest.raises(ArtefactError, match=r"the first one below it is .*run$"):
        ge.load_run(tmp_path)
