"""The page of a study says what its journal says."""

import re

import pytest
from tuning_for_tests import MadeUp, made_up_study, small_task

from ge_torchrl.tuning.findings import findings_of
from ge_torchrl.tuning.page import tuning_page

TASK = small_task()


@pytest.fixture
def study(tmp_path, monkeypatch):
    MadeUp(monkeypatch)

    def made(trials, task=TASK):
        made_up_study(tmp_path, task, trials)
        return findings_of(tmp_path, task)

    return made


def test_it_shows_every_trial_and_loads_nothing(study, tmp_path):
    findings = study(30)
    page = tuning_page(tmp_path, findings, "x")
    assert f"Trial {findings.best.number} did best" in page
    assert page.count("<circle") >= 30
    assert page.count("<tr>") == 30 + 1 + 3 + 1
    for key in (one.key for one in TASK.space):
        assert page.count(key) >= 3, "settings, shares and drawings"
    assert f"--config-dir {tmp_path} experiment=tuned_x" in page
    assert not re.search(r"https?://|<link(?! rel=\"icon\" href=\"data:)|nan|inf\b", page)
    assert tuning_page(tmp_path, findings, "x") == page


def test_equal_returns_and_few_trials_are_shown_too(study, tmp_path, monkeypatch):
    monkeypatch.setattr("tuning_for_tests.made_up", lambda _config: 500.0)
    page = tuning_page(tmp_path, study(3), "x")
    assert "No trial did better than the settings as they stand" in page
    assert "Too few trials" in page
    assert "There is nothing to use" in page


def test_a_study_without_an_end_is_shown_too(study, tmp_path):
    findings = study(1)
    page = tuning_page(tmp_path, type(findings)(TASK, (), 0, {}), "x")
    assert "No trial has come to its end" in page
