"""A run in memory leaves what a run in a folder leaves."""

import io
from dataclasses import asdict

import pytest
from rich.console import Console
from runs_for_tests import config

from ge_torchrl.artefacts.episodes import episodes_text
from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.artefacts.memory import RunMemory
from ge_torchrl.artefacts.records import CLOCK_FIELDS
from ge_torchrl.errors import ArtefactError
from ge_torchrl.run.experiment import carry_out


def still(record):
    return {key: value for key, value in asdict(record).items() if key not in CLOCK_FIELDS}


def test_it_reads_as_the_folder_does(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    console = Console(file=io.StringIO())
    (tmp_path / "run").mkdir()
    in_memory, in_folder = (
        carry_out(config(ge={"generations": 4}), keep, console).artefacts
        for keep in (RunMemory, lambda decided: RunFolder.create(tmp_path / "run" / "one", decided))
    )
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    assert in_memory.read_config() == in_folder.read_config()
    assert in_memory.read_best_tree() == in_folder.read_best_tree()
    assert in_memory.read_best_tree_full() == in_folder.read_best_tree_full()
    assert in_memory.read_archive() == in_folder.read_archive()
    sizes = [record.decision_nodes for record in in_memory.read_archive()]
    assert sizes
    for size in sizes:
        assert in_memory.read_archive_tree(size) == in_folder.read_archive_tree(size)
    assert list(map(still, in_memory.read_history())) == list(map(still, in_folder.read_history()))
    assert in_memory.read_refinements() == []
    assert still(in_memory.read_summary()) == still(in_folder.read_summary())
    assert episodes_text(in_memory.read_episodes()) == episodes_text(in_folder.read_episodes())
    with pytest.raises(ArtefactError, match="no tree with 99 decision nodes"):
        in_memory.read_archive_tree(99)


def test_before_the_end_it_says_so():
    memory = RunMemory(config())
    with pytest.raises(ArtefactError, match="no tree yet"):
        memory.read_best_tree()
    with pytest.raises(ArtefactError, match="no summary"):
        memory.read_summary()
    assert memory.read_archive() == []
