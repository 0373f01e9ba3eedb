"""Episodes of the test that a run keeps: which, that they are the test's own, and that they never cost the run."""

from dataclasses import replace

import numpy as np
import pytest
from plants_for_tests import MOTOR
from runs_for_tests import config, run

from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.environments.backend import LimitReachedError
from ge_torchrl.environments.kernel_backend import KernelBackend
from ge_torchrl.environments.spec import describe
from ge_torchrl.run import episodes as episodes_module
from ge_torchrl.run.episodes import step_seconds


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "run"
    summary, output = run(config(), folder)
    return RunFolder(folder), summary, output


def test_the_champion_plays_its_best_median_and_worst_episode_as_in_the_test(finished):
    folder, summary, _ = finished
    episodes = folder.read_episodes()
    assert (episodes.returns.mean(), len(episodes.returns)) == (summary.test_mean, 20)
    own = {one.rank: one for one in episodes.recorded if one.tree == "champion"}
    in_order = np.sort(episodes.returns)
    assert (own["worst"].total, own["median"].total, own["best"].total) == (
        in_order[0],
        in_order[9],
        in_order[-1],
    )
    tree = folder.read_best_tree().tree
    for one in episodes.recorded:
        assert one.rewards.sum() == pytest.approx(one.total)
        assert len(one.observations) == len(one.actions) + 1 == len(one.rewards) + 1 == one.length + 1
        assert one.terminated or one.truncated
        if one.tree == "champion":
            np.testing.assert_array_equal(tree.decide(one.observations[:-1]), one.actions)


def test_trees_of_other_sizes_play_one_episode_each(finished):
    folder, summary, _ = finished
    others = [one for one in folder.read_episodes().recorded if one.tree != "champion"]
    sizes = [record.decision_nodes for record in folder.read_archive()]
    assert [int(one.tree) for one in others] == [size for size in sizes if size != summary.decision_nodes]
    assert {one.rank for one in others} == {"median"}


def test_every_tested_tree_has_its_visits(finished):
    folder, summary, _ = finished
    visits = folder.read_episodes().visits
    assert len(visits["champion"]) == folder.read_best_tree().tree.num_leaves
    assert len(visits["full"]) == folder.read_best_tree_full().tree.num_leaves
    assert visits["champion"].sum() == folder.read_episodes().returns.sum(), (
        "CartPole rewards every step by 1"
    )
    for record in folder.read_archive():
        assert len(visits[str(record.decision_nodes)]) == record.decision_nodes + 1
    assert summary.steps["record"] == sum(one.length for one in folder.read_episodes().recorded)


def test_the_run_says_where_its_page_is(finished):
    folder, _, output = finished
    assert f"page        {folder.path / 'report.html'}" in output


@pytest.mark.parametrize(
    "fault", [LimitReachedError("max_seconds"), KeyboardInterrupt(), ValueError("no\nplay")]
)
def test_what_breaks_while_recording_does_not_break_the_run(tmp_path, monkeypatch, fault):
    def breaking(*_):
        raise fault

    monkeypatch.setattr(KernelBackend, "record", breaking)
    summary, _ = run(config(ge={"generations": 2}), tmp_path / "run")
    told = ("No more episodes could be recorded: no play",) if isinstance(fault, ValueError) else ()
    assert summary.warnings == told
    episodes = RunFolder(tmp_path / "run").read_episodes()
    assert (episodes.recorded, len(episodes.returns)) == ((), 20)


def test_a_page_that_cannot_be_made_is_told_in_one_line(tmp_path, monkeypatch):
    from ge_torchrl.report.html import writing

    def breaking(*_):
        raise ZeroDivisionError("a bug\nof ours")

    monkeypatch.setattr(writing, "run_page", breaking)
    _, output = run(config(ge={"generations": 2}), tmp_path / "run")
    line = "no page was written, and the run is complete without it (ZeroDivisionError: a bug of ours)"
    assert line in output.splitlines()
    assert "report.html" not in output
    assert (tmp_path / "run" / "summary.json").exists()


def test_a_file_that_cannot_be_written_is_told_in_one_line(tmp_path, monkeypatch):
    def breaking(*_):
        raise OSError("the disk\nis full")

    monkeypatch.setattr(RunFolder, "write_episodes", breaking)
    summary, _ = run(config(ge={"generations": 2}), tmp_path / "run")
    assert summary.warnings == ("The episodes could not be written: the disk is full",)


def test_long_episodes_are_cut_and_their_length_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(episodes_module, "_MOST_NUMBERS", 16)
    run(config(ge={"generations": 2}), tmp_path / "run")
    for one in RunFolder(tmp_path / "run").read_episodes().recorded:
        assert len(one.rewards) == 3 < one.length
        assert one.observations.shape == (4, 4)


def test_the_length_of_a_step_is_that_of_a_plant_without_wrappers():
    spec = describe(MOTOR)
    assert step_seconds(spec) == 0.01
    wrapped = replace(spec, names=replace(spec.names, wrappers=("module:Skips",)))
    assert [step_seconds(one) for one in (wrapped, describe("CartPole-v1"))] == [None, None]
