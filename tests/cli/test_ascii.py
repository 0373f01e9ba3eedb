"""A terminal that knows only ASCII gets ASCII that can be read, of every command."""

import io
import re
import sys

import pytest
from documents_for_tests import CONTROLLER
from sweeps_for_tests import write_run

from ge_torchrl.__main__ import main
from ge_torchrl.artefacts.jobs import Sweep, write_sweep
from ge_torchrl.cli import VERBS
from ge_torchrl.report import canvas
from ge_torchrl.trees.files import write_controller

TINY = ["env=cartpole", "refiner=none", "polish=none", "ge.generations=1", "ge.max_env_steps=60000"]
LINES = {
    "check": ["CartPole-v1"],
    "completion": ["zsh"],
    "evaluate": ["tree.json", "--episodes", "2"],
    "explain": ["env.units"],
    "export": ["tree.json", "--to", "text"],
    "init": ["CartPole-v1"],
    "play": ["tree.json", "--steps", "2", "--out", "episode.gif"],
    "report": ["runs"],
    "resume": ["runs/0"],
    "status": ["runs"],
    "tune": [*TINY, "--trials", "1"],
}


def printed(words, monkeypatch, *, is_terminal=False):
    """Run a command as LANG=C and PYTHONIOENCODING=ascii do; return what it prints, output and errors."""
    streams = [io.TextIOWrapper(io.BytesIO(), encoding="ascii") for _ in range(2)]
    monkeypatch.setattr(streams[0], "isatty", lambda: is_terminal)
    with monkeypatch.context() as patched:
        patched.setattr(sys, "stdout", streams[0])
        patched.setattr(sys, "stderr", streams[1])
        assert main(words) == 0
        for stream in streams:
            stream.flush()
    return [stream.buffer.getvalue().decode("ascii") for stream in streams]


def test_every_command_is_tried():
    assert set(LINES) == VERBS


@pytest.mark.parametrize("verb", sorted(LINES))
def test_what_a_command_prints_is_ascii(verb, tmp_path, monkeypatch):
    if verb == "play":
        pytest.importorskip("PIL")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(canvas, "find_spec", lambda _: None)
    write_controller(tmp_path / "tree.json", CONTROLLER)
    write_run(tmp_path / "runs" / "0")
    write_sweep(tmp_path / "runs", Sweep((("seed=3",),), ("-m", "seed=3")))
    output, errors = printed([verb, *LINES[verb]], monkeypatch)
    assert output
    assert re.search(r"\?(?!\s)", output) is None
    assert "\\u" not in errors
    if verb in ("evaluate", "report"):
        assert " +- " in output


def test_a_table_that_is_drawn_is_ascii_too(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(canvas, "find_spec", lambda _: None)
    write_run(tmp_path / "runs" / "0")
    output, _ = printed(["report", "runs"], monkeypatch, is_terminal=True)
    assert "-----" in output
    assert " +- " in output
