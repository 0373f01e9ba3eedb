import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from documents_for_tests import CONTROLLER, WIDE
from exports_for_tests import formats
from pages_for_tests import ROOT
from records_for_tests import kept

from ge_torchrl.__main__ import main
from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.cli.exporting import TO
from ge_torchrl.exports import exporting
from ge_torchrl.exports.formats import FORMATS
from ge_torchrl.trees.files import from_json, read_controller, write_controller

TREE = str(ROOT / "docs" / "trees" / "cartpole_two_decisions.json")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def run(folder):
    """A run's folder: a champion, and an archive with another tree."""
    path = folder / "run"
    path.mkdir()
    RunFolder(path).write_trees(CONTROLLER, CONTROLLER, "a tree")
    RunFolder(path).write_archive([(kept(1, 100.0), WIDE)])
    return path


def test_a_run_gives_its_champion_or_a_tree_of_its_archive(run, capsys):
    assert main(["export", str(run), "--to", "json"]) == 0
    assert from_json(capsys.readouterr().out) == CONTROLLER
    assert main(["export", str(run), "--to", "json", "--nodes", "1"]) == 0
    assert from_json(capsys.readouterr().out) == WIDE
    assert main(["export", str(run), "--to", "json", "--nodes", "2"]) == 2
    assert "the number of decision nodes must be one of 1" in capsys.readouterr().err


@pytest.mark.parametrize("to", formats([to for to in FORMATS if FORMATS[to].is_text]))
def test_a_text_goes_to_standard_output_and_nothing_else_does(folder, capsys, to):
    assert main(["export", TREE, "--to", to]) == 0
    printed = capsys.readouterr()
    assert printed.out == exporting.exported(read_controller(TREE), to).decode()
    assert printed.err == ""
    assert list(folder.iterdir()) == []


def test_a_file_is_written_and_told(folder, capsys):
    assert main(["export", TREE, "--to", "onnx", "--out", "pole.onnx"]) == 0
    assert capsys.readouterr().out == "wrote pole.onnx: it answers 10,000 observations as the tree does\n"
    assert (folder / "pole.onnx").read_bytes() == exporting.exported(read_controller(TREE), "onnx")
    assert main(["export", TREE, "--to", "c", "--out", "pole.c", "--name", "pole", "--unverified"]) == 0
    assert capsys.readouterr().out == "wrote pole.c, unverified\n"
    assert "int pole(" in (folder / "pole.c").read_text()
    assert main(["export", TREE, "--to", "json", "--out", "new/folder/pole.json", "--unverified"]) == 0
    assert (folder / "new" / "folder" / "pole.json").is_file()
    assert sorted(path.name for path in folder.iterdir()) == ["new", "pole.c", "pole.onnx"]


def test_what_answers_otherwise_leaves_no_file_and_the_old_one_as_it_was(folder, capsys, monkeypatch):
    form = FORMATS["python"]._replace(answers=lambda _, observed: [np.zeros(len(observed[0]), int)])
    monkeypatch.setattr(exporting, "FORMATS", {"python": form})
    (folder / "old.py").write_text("old")
    for name in ("new.py", "old.py"):
        assert main(["export", TREE, "--to", "python", "--out", name]) == 1
        told = capsys.readouterr()
        assert told.out == ""
        assert told.err.startswith("ge-torchrl: the exported python answers ")
        assert told.err.count("\n") == 1
    assert [(path.name, path.read_text()) for path in folder.iterdir()] == [("old.py", "old")]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([TREE, "--to", "rust"], "argument --to: invalid choice: 'rust' (choose from"),
        ([TREE, "--to", "cpp"], "did you mean c?; see --help"),
        ([TREE, "--to", "c", "--ot", "x"], "unrecognized arguments: --ot x; did you mean --out?; see --help"),
        ([TREE], "required: --to"),
        ([TREE, "--to", "onnx"], "--to onnx is no text for a terminal, so expected --out FILE"),
        ([TREE, "--to", "c", "--name", "2"], "--name must be letters"),
        (
            [TREE, "--to", "c", "--nodes", "2"],
            "--nodes chooses a tree of a run, so expected a run's folder; got",
        ),
        ([TREE, "--to", "c", "--out", f"{TREE}/no.c"], "cannot be written: "),
        (
            ["nowhere.json", "--to", "c"],
            "expected a tree's file or a run's folder; there is none at nowhere.json",
        ),
        (
            [str(ROOT / "docs"), "--to", "c"],
            "docs must be the folder of one run, which holds best_tree.json; it holds",
        ),
        ([str(ROOT / "docs" / "trees" / "pendulum_one_split.json"), "--to", "sklearn"], "linear leaves"),
    ],
)
def test_a_mistake_is_one_line(folder, capsys, words, told):
    assert main(["export", *words]) == 2
    shown = capsys.readouterr()
    assert told in shown.err
    assert shown.err.count("\n") == 1
    assert shown.out == ""
    assert list(folder.iterdir()) == []


def test_the_command_line_knows_all_formats():
    assert tuple(FORMATS) == TO


def test_help_tells_of_formats_and_exit_statuses(capsys):
    with pytest.raises(SystemExit):
        main(["export", "--help"])
    shown = capsys.readouterr().out
    assert all(f"  {to}" in shown or f", {to}" in shown for to in FORMATS)
    assert "exit status: 0" in shown


def test_a_pipe_keeps_the_names_whatever_the_encoding_of_the_terminal(folder):
    names = replace(CONTROLLER.names, features=("θ", "ω", "x", "y"))
    write_controller(folder / "tree.json", replace(CONTROLLER, names=names))
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    command = [sys.executable, "-m", "ge_torchrl", "export", "tree.json", "--to", "python"]
    told = subprocess.run(command, env=environment, capture_output=True, check=True)
    assert 'FEATURES = ("θ", "ω", "x", "y")' in told.stdout.decode()


def test_a_terminal_that_knows_only_ascii_gets_a_text():
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    command = [sys.executable, "-m", "ge_torchrl", "export", TREE, "--to", "text"]
    told = subprocess.run(command, env=environment, capture_output=True, check=True)
    assert told.stdout.decode("ascii").splitlines()[1].startswith("|- yes: ")
