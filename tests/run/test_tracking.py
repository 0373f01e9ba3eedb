"""Trackers are told what happens, and none of them can fail a run."""

import csv
import os
import sys
import types

import pytest
from runs_for_tests import config, run

from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.config import Config
from ge_torchrl.errors import ConfigError

SHORT = {"generations": 3}


class Loggers(types.ModuleType):
    """Stands in for TorchRL's loggers: remembers what it is told, and fails where it is told to."""

    def __init__(self, fails=None, fault=None):
        super().__init__("torchrl.record.loggers")
        self.told, self.opened, self._fails, self._fault = [], [], fails, fault

    def __getattr__(self, name):
        if not name.endswith("Logger"):
            raise AttributeError(name)

        def opened(**arguments):
            self._failing("open")
            self.opened.append((name, arguments))
            return self

        return opened

    def _failing(self, place):
        if place == self._fails:
            raise self._fault

    def log_hparams(self, settings):
        self._failing("log_hparams")
        self.told.append(settings)

    def log_metrics(self, metrics, step):
        self._failing("log_metrics")
        self.told.append((step, metrics))

    def close(self):
        self._failing("close")
        self.told.append("closed")


def told_to(monkeypatch, *arguments):
    loggers = Loggers(*arguments)
    for name in ("torchrl", "torchrl.record"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    monkeypatch.setattr(sys.modules["torchrl.record"], "loggers", loggers, raising=False)
    monkeypatch.setitem(sys.modules, loggers.__name__, loggers)
    return loggers


def logging_to(logger, **sections):
    values = config(ge=SHORT, **sections).as_mapping()
    return Config.from_mapping({**values, "logger": logger})


def test_by_default_nobody_is_told(tmp_path, monkeypatch):
    loggers = told_to(monkeypatch)
    assert config().logger == "none"
    run(config(ge=SHORT), tmp_path / "run")
    assert (loggers.opened, loggers.told) == ([], [])


def test_it_is_told_the_settings_every_generation_and_the_verdict(tmp_path, monkeypatch):
    loggers = told_to(monkeypatch)
    summary, _ = run(logging_to("tensorboard"), tmp_path / "run")
    ((name, arguments),) = loggers.opened
    assert (name, arguments["log_dir"]) == ("TensorboardLogger", str(tmp_path / "run"))
    settings, *steps, verdict, closed = loggers.told
    assert settings["ge.generations"] == 3
    assert "grammar.bnf" not in settings
    assert all(isinstance(value, str | int | float) for value in settings.values())
    history = RunFolder(tmp_path / "run").read_history()
    assert [(step, told["fitness/best"]) for step, told in steps] == [
        (one.generation, one.best) for one in history
    ]
    assert steps[-1][1]["search/env_steps"] == history[-1].env_steps
    assert "kept/01_nodes" in steps[-1][1]
    assert verdict[0] == 2
    assert verdict[1]["champion/test_mean"] == summary.test_mean
    assert closed == "closed"


def test_csv_needs_no_extra(tmp_path):
    run(logging_to("csv"), tmp_path / "run")
    with (tmp_path / "run" / "csv" / "scalars" / "fitness" / "best.csv").open() as file:
        rows = [(int(step), float(best)) for step, best in csv.reader(file)]
    assert rows == [(one.generation, one.best) for one in RunFolder(tmp_path / "run").read_history()]


@pytest.mark.parametrize("place", ["open", "log_hparams", "log_metrics", "close"])
@pytest.mark.parametrize("fault", [OSError(28, "No space left on device"), RuntimeError("no\nnetwork")])
def test_one_that_fails_fails_no_run(tmp_path, monkeypatch, place, fault):
    loggers = told_to(monkeypatch, place, fault)
    summary, output = run(logging_to("wandb"), tmp_path / "run")
    (warning,) = summary.warnings if place != "close" else (output.partition("warning: ")[2].splitlines()[0],)
    assert warning.startswith("logger=wandb failed and is left out, and the run goes on (")
    assert "\n" not in warning
    assert output.count("logger=wandb failed") == (1 if place == "close" else 2), (
        "as it happens, and at the end"
    )
    assert summary.stopped_by == "generations"
    assert not any(isinstance(one, tuple) for one in loggers.told) or place == "close"


@pytest.mark.parametrize(
    ("name", "told"), [("wandb", '-c constraints.txt -e ".[trackers]"'), ("mlflow", '-e ".[mlflow]"')]
)
def test_an_extra_that_is_missing_is_named(tmp_path, monkeypatch, name, told):
    told_to(monkeypatch, "open", ImportError(f"{name} could not be imported"))
    _, output = run(logging_to(name), tmp_path / "run")
    assert f"pip install {told}" in output


@pytest.mark.parametrize("elsewhere", [None, "http://tracker.test"])
def test_mlflow_may_write_files_where_no_server_is_named(tmp_path, monkeypatch, elsewhere):
    loggers = told_to(monkeypatch)
    monkeypatch.setitem(sys.modules, "mlflow", types.SimpleNamespace(end_run=lambda: None))
    # Set first, so that what the run sets is taken away afterwards.
    for name in ("MLFLOW_ALLOW_FILE_STORE", "MLFLOW_TRACKING_URI"):
        monkeypatch.setenv(name, elsewhere or "")
        monkeypatch.delenv(name)
    if elsewhere:
        monkeypatch.setenv("MLFLOW_TRACKING_URI", elsewhere)
    run(logging_to("mlflow"), tmp_path / "run")
    ((_, arguments),) = loggers.opened
    assert arguments["tracking_uri"] == (elsewhere or (tmp_path / "run" / "mlflow").as_uri())
    assert os.environ.get("MLFLOW_ALLOW_FILE_STORE") == (None if elsewhere else "true")


def test_another_one_is_refused():
    with pytest.raises(
        ConfigError, match="logger must be one of none, csv, tensorboard, wandb, mlflow; got 'print'"
    ):
        logging_to("print")
