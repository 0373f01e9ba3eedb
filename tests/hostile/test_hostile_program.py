"""The program itself: each bad command line ends with status 2 and one line, and nothing is written."""

import json
import os

import pytest
from hostile_trees import sound_document
from hostile_verdicts import LONGEST_MESSAGE

from ge_torchrl.__main__ import main


@pytest.mark.parametrize(
    "words",
    [
        ["evaluate", "pipe"],
        ["evaluate", "/dev/zero"],
        ["evaluate", "a" * 5000],
        ["evaluate", "tree.json", "--seed", "1" * 23],
        ["evaluate", "tree.json", "--seed", "1" * 5000],
        ["evaluate", "tree.json", "--episodes", "1" * 5000],
        ["evaluate", "red.json"],
        ["export", "pipe", "--to", "c"],
        ["export", "tree.json", "--to", "c", "--out", "tree.json/tree.c"],
        ["export", "tree.json", "--to", "\x1b[31m"],
        ["play", "/dev/zero", "--out", "episode.gif"],
        ["report", "a" * 5000],
        ["report", "tree.json"],
        ["report", "pipe"],
        ["explain", "\x1b[31m" * 1000],
        ["check", "a" * 100_000],
        ["-m", "seed=range(0,0)"],
        ["ge.population_size=2000000000"],
        ["seed=" + "1" * 5000],
    ],
)
def test_a_bad_command_line_is_one_line_and_leaves_nothing(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    document = sound_document()
    (tmp_path / "tree.json").write_text(json.dumps(document))
    document["environment"]["features"][0] = "\x1b[31m"
    (tmp_path / "red.json").write_text(json.dumps(document))
    assert main(words) == 2
    told = capsys.readouterr().err.removesuffix("\n")
    assert told.isprintable()
    assert len(told) < LONGEST_MESSAGE + 100
    assert {path.name for path in tmp_path.iterdir()} == {"pipe", "tree.json", "red.json"}
