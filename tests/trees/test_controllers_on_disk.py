"""Trees in files: whole or not at all."""

from pathlib import Path

import pytest
from documents_for_tests import CONTROLLER, TEXT

from ge_torchrl.errors import ArtefactError, InvalidTreeError
from ge_torchrl.trees.files import read_controller, write_controller


def test_file_round_trip(tmp_path):
    path = tmp_path / "best.json"
    write_controller(path, CONTROLLER)
    assert path.read_bytes() == TEXT.encode()
    assert read_controller(path) == CONTROLLER
    assert read_controller(str(path)) == CONTROLLER


def test_a_file_is_replaced_and_nothing_else_stays(tmp_path):
    path = tmp_path / "best.json"
    path.write_text("old")
    write_controller(path, CONTROLLER)
    assert read_controller(path) == CONTROLLER
    assert list(tmp_path.iterdir()) == [path]


def test_a_failed_write_leaves_the_old_file_alone(tmp_path, monkeypatch):
    path = tmp_path / "best.json"
    path.write_text("old")

    def full_disk(_self, _target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full_disk)
    with pytest.raises(ArtefactError, match=r"best\.json: cannot write the tree: No space left on device"):
        write_controller(path, CONTROLLER)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_missing_folder_is_refused(tmp_path):
    with pytest.raises(ArtefactError, match="cannot write the tree: No such file"):
        write_controller(tmp_path / "missing" / "best.json", CONTROLLER)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(ArtefactError, match=r"missing\.json cannot be read: No such file"):
        read_controller(tmp_path / "missing.json")


def test_a_folder_is_no_tree(tmp_path):
    with pytest.raises(ArtefactError, match="must be a file; it is a folder"):
        read_controller(tmp_path)


def test_a_file_with_an_error_is_named(tmp_path):
    path = tmp_path / "best.json"
    path.write_text("{}")
    with pytest.raises(InvalidTreeError, match=r"best\.json: format: expected"):
        read_controller(path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(ArtefactError, match=r"best\.json is not text in UTF-8"):
        read_controller(path)
