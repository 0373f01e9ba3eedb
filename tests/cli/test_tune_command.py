"""`tune` as it is typed."""

import importlib.util

import pytest

from ge_torchrl.__main__ import main
from ge_torchrl.cli import tuning

SMALL = [
    "env=cartpole", "refiner=none", "polish=none", "ge.generations=2", "ge.population_size=20",
    "ge.max_env_steps=100000", "evaluation.validation_episodes=20", "evaluation.test_episodes=20",
    "archive.episodes=20",
]  # fmt: skip


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_a_study_is_carried_out_and_goes_on(tmp_path, capsys):
    words = [
        "tune",
        *SMALL,
        "--seeds",
        "1",
        "--space",
        "ge.gene_probability=0.01..0.5",
        "--space",
        "ge.tournament_size=2..8",
    ]
    assert main([*words, "--trials", "2"]) == 0
    first = capsys.readouterr().out
    assert "CartPole-v1: 2 trials over 2 settings, up to 1 run each, of at most 100,000 steps" in first
    assert first.count("\ntrial ") == 2
    assert (tmp_path / "tuning" / "cartpole" / "report.html").is_file()
    assert main([*words, "--trials", "8"]) == 0
    printed = capsys.readouterr().out
    assert printed.count("\ntrial ") == 6
    presets = list(tmp_path.glob("tuning/cartpole/experiment/tuned_cartpole.yaml"))
    assert len(presets) == ("did best" in printed)
    assert main([*words, "--trials", "8", "--seeds", "2"]) == 2
    assert "holds trials of another study, which differs in --seeds" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--trials", "0"], "must be an integer from 1 to"),
        (["env=nothing"], "env=nothing is unknown; expected one of"),
        (["mountaincar"], "expected key=value, such as env=mountaincar; got 'mountaincar'"),
        (["env=cartpole", "--space", "ge.mutation=0..1"], "ge.mutation is unknown"),
        (["env=cartpole", "seed=1,2"], "seed must be one value"),
        (["env=cartpole", "--config-dir", "nowhere"], "--config-dir must be a folder with choices"),
    ],
)
def test_mistakes_are_one_line(arguments, told, capsys, tmp_path):
    assert main(["tune", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line
    assert not any(tmp_path.iterdir())


def test_optuna_is_asked_for_in_one_line(monkeypatch, capsys):
    found = importlib.util.find_spec
    monkeypatch.setattr(tuning, "find_spec", lambda name: None if name == "optuna" else found(name))
    assert main(["tune", "env=cartpole"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith('expected it installed: pip install -c constraints.txt -e ".[tune]"')
