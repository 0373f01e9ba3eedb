"""Whatever the disk does, a run can go on from its last generation or the one before (law 8)."""

import io

import pytest
from disks_for_tests import Disk, KilledError
from problems_for_tests import FEATURES, UNITS
from records_for_tests import kept
from rich.console import Console
from runs_for_tests import assert_same_bytes, config, run
from sweeps_for_tests import FULL, PRUNED, chain, controller

from ge_torchrl.artefacts.checkpoints import Checkpoint, sound_checkpoint
from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.errors import ArtefactError
from ge_torchrl.run import checkpointing, experiment
from ge_torchrl.trees.controller import Names

NAMES = Names("CartPole-v1", FEATURES, UNITS, ("left", "right"))
SMALL = {
    "ge": {"generations": 4, "population_size": 10},
    "evaluation": {"episodes": 2, "validation_episodes": 5, "test_episodes": 5},
    "refiner": {"method": "cmaes", "schedule": {"every": 2}, "acceptance_episodes": 3, "min_nodes": 1},
    "polish": {"max_timesteps": 500, "every": 1, "episodes": 3},
    "archive": {"keep": 1, "episodes": 3, "neighbours": 1, "neighbours_drawn": 3, "max_nodes": 3, "final_keep": 1},
}  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def after_every_generation():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(checkpointing, "_TIMES", 0)
        yield


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """What a run wrote: its records and checkpoints, in their order."""
    records, noted = [], []

    class Noting(RunFolder):
        def write_checkpoint(self, checkpoint):
            noted.append(checkpoint)
            super().write_checkpoint(checkpoint)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(experiment, "RunFolder", Noting)
        run(config(**SMALL), tmp_path_factory.mktemp("written") / "run")
    folder = RunFolder(tmp_path_factory.getbasetemp() / "written0" / "run")
    records = folder.read_history()
    return records, [one for one in noted if one.stopped_by is None]


def write_again(path, written, disk):
    """Write records, trees and checkpoints as the run did, until the disk is pulled out."""
    with disk:
        folder = RunFolder.create(path, config(**SMALL))
        try:
            with folder.history_writer() as history:
                for record, checkpoint in zip(*written, strict=True):
                    history.write(record)
                    size = 1 + record.generation % 2
                    folder.write_trees(controller(PRUNED), controller(FULL), "a tree\n")
                    folder.write_archive([(kept(size, 1.0), controller(chain(size)))])
                    lines = folder.lines
                    folder.write_checkpoint(Checkpoint(**{**vars(checkpoint), "lines": lines}))
        finally:
            folder.release()


def test_the_process_dies_in_any_write_sync_or_rename(tmp_path, written, tried):
    disk = Disk()
    write_again(tmp_path / "whole", written, disk)
    assert set(disk.calls) == {"write", "fsync", "replace"}
    assert len(disk.calls) > 60
    for call in range(len(disk.calls)):
        folder = tmp_path / str(call)
        with pytest.raises(KilledError):
            write_again(folder, written, Disk(dies_at=call))
        n_recorded = len(RunFolder(folder).read_history()) if (folder / "history.jsonl").exists() else 0
        if n_recorded > 1:
            found = sound_checkpoint(folder, NAMES, told=pytest.fail)
            assert found.state.generation in (n_recorded - 1, n_recorded - 2)
        for name in ("best_tree.json", "archive/01.json", "archive/02.json"):
            if (folder / name).exists():
                assert RunFolder(folder / name).path.read_text().endswith("}\n")
    tried("deaths in a write, a sync or a rename", len(disk.calls), 0)


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The run left alone, and how many bytes it writes."""
    folder = tmp_path_factory.mktemp("alone") / "run"
    with Disk() as disk:
        run(config(**SMALL), folder)
    # A run is complete without its page.
    return folder, disk.written - (folder / "report.html").stat().st_size


class TestFull:
    def at(self, share, alone, tmp_path, tried):
        folder, n_bytes = alone
        path = tmp_path / "run"
        with Disk(room=int(share * n_bytes)), pytest.raises(ArtefactError) as raised:
            run(config(**SMALL), path)
        assert "\n" not in str(raised.value)
        assert f"{path}" in str(raised.value)
        assert "No space left on device" in str(raised.value)
        if (path / "config.yaml").exists():
            experiment.resume(path, Console(file=io.StringIO()))
            assert_same_bytes(folder, path)
        tried("full disks", 1, 0)

    @pytest.mark.parametrize("share", [0.001, 0.05, 0.4, 0.8, 0.99])
    def test_it_is_told_in_one_line_and_the_run_goes_on_where_there_is_room(
        self, share, alone, tmp_path, tried
    ):
        self.at(share, alone, tmp_path, tried)

    @pytest.mark.slow
    @pytest.mark.parametrize("share", [number / 20 for number in range(20)])
    def test_everywhere(self, share, alone, tmp_path, tried):
        self.at(share, alone, tmp_path, tried)
