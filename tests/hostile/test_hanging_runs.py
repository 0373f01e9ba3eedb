"""A run whose environment hangs ends with one line and its best tree, and goes on once that is mended."""

import io

import pytest
from environments_for_tests import register
from hanging_environments import HangingCartPoleEnv
from rich.console import Console
from runs_for_tests import assert_same_bytes, assert_untested, config, run

from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.environments import hangs
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.run import checkpointing, experiment, running


def test_it_ends_with_the_best_tree_and_goes_on_as_if_nothing_had_been(tmp_path, monkeypatch):
    monkeypatch.setattr(hangs, "_LOOK_SECONDS", 0.05)
    monkeypatch.setattr(checkpointing, "_TIMES", 0)
    settings = config(
        env={"id": register(HangingCartPoleEnv), "max_episode_steps": 50, "workers": 1, "step_seconds": 0.5},
        ge={"population_size": 10, "generations": 8},
        evaluation={"episodes": 2, "validation_episodes": 5, "test_episodes": 5},
        archive={"episodes": 3},
    )
    run(settings, tmp_path / "alone")
    show = running.Progress.show

    def then_hangs(self, record, *more):
        show(self, record, *more)
        monkeypatch.setattr(HangingCartPoleEnv, "hangs", record.generation == 4)

    monkeypatch.setattr(running.Progress, "show", then_hangs)
    path = tmp_path / "run"
    told = r"must return .*within 0\.5 s.*; the best tree so far is in .*; ge-torchrl resume .* goes on$"
    with pytest.raises(EnvironmentFaultError, match=told) as caught:
        run(settings, path)
    assert "\n" not in str(caught.value)
    assert_untested(RunFolder(path))
    monkeypatch.setattr(running.Progress, "show", show)
    monkeypatch.setattr(HangingCartPoleEnv, "hangs", False)
    experiment.resume(path, Console(file=io.StringIO()))
    assert_same_bytes(tmp_path / "alone", path)
