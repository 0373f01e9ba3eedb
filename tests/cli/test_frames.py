"""What an environment raised is told with the place in the user's own file."""

import importlib

from ge_torchrl.cli.output import tell
from ge_torchrl.errors import ConfigError, EnvironmentFaultError

MOTOR = """\
def step():
    return spin()


def spin():
    raise OSError("no current")
"""


def raised(tmp_path, monkeypatch, kind):
    (tmp_path / "motor_of_mine.py").write_text(MOTOR)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    error = kind("env.id=Mine-v0 raised OSError('no current'); episode seed 3, step 7")
    try:
        importlib.import_module("motor_of_mine").step()
    except OSError as cause:
        error.__cause__ = cause
    return error


def test_a_fault_of_an_environment_is_told_with_its_place(tmp_path, monkeypatch, capsys):
    error = raised(tmp_path, monkeypatch, EnvironmentFaultError)
    assert tell(error) == 2
    told = capsys.readouterr().err
    assert told.startswith(
        f"ge-torchrl: {error}; raised at motor_of_mine.py:6 in spin, called at motor_of_mine.py:2 in step"
    )
    assert told.count("\n") == 1


def test_what_a_worker_told_of_its_traceback_is_read(capsys):
    error = EnvironmentFaultError("env.id=Mine-v0 raised OSError()")
    error.__cause__ = RuntimeError(
        'Traceback:\n  File "/home/me/motor.py", line 6, in spin\n    raise OSError()'
    )
    tell(error)
    assert "; raised at /home/me/motor.py:6 in spin" in capsys.readouterr().err


def test_other_mistakes_are_told_as_they_are(tmp_path, monkeypatch, capsys):
    error = raised(tmp_path, monkeypatch, ConfigError)
    tell(error)
    assert capsys.readouterr().err == f"ge-torchrl: {error}\n"
