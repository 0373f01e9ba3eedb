"""Trials are carried out once each, whatever kills their process, and none of them sees a test."""

import time

import pytest
from rich.console import Console
from tuning_for_tests import MadeUp, made_up_study, small_task

from ge_torchrl.errors import ArtefactError, ConfigError, RunFaultError, UserError
from ge_torchrl.search import fitness
from ge_torchrl.seeding import EPISODE_SEEDS, episode_seeds
from ge_torchrl.tuning import objective
from ge_torchrl.tuning.book import JOURNAL, Book, forget_failed
from ge_torchrl.tuning.findings import COMPLETE, ENDED, FAILED, findings_of
from ge_torchrl.tuning.task import check_same, read_task, tuning_seeds, write_task
from ge_torchrl.tuning.work import work

TASK = small_task()


@pytest.fixture
def runs(monkeypatch):
    return MadeUp(monkeypatch)


def told(folder, task=TASK):
    """What is known of each trial, by its place."""
    return [(one.state, one.value, dict(one.values)) for one in findings_of(folder, task).tried]


def test_the_settings_as_they_stand_come_first_and_the_best_are_found(tmp_path, runs):
    printed = made_up_study(tmp_path, TASK, 30)
    findings = findings_of(tmp_path, TASK)
    first = findings.tried[0]
    assert first.is_untuned
    assert first.values == {
        "ge.gene_probability": 0.1,
        "ge.tournament_size": 2,
        "ge.parsimony": "lexicographic",
    }
    assert (len(findings.tried), first.state, len(first.returns)) == (30, COMPLETE, 2)
    assert findings.is_better
    assert findings.best.value > first.value + 5
    assert findings.count(ENDED) >= 10, "poor trials end early"
    assert findings.count(ENDED) + findings.count(COMPLETE) == 30
    assert sum(findings.importances.values()) == pytest.approx(1)
    assert max(findings.importances, key=findings.importances.get) != "ge.parsimony", "which does nothing"
    assert len({seed for *_, seed in runs.runs}) == TASK.runs, "all trials have the same seeds"
    assert "ended early, on its first run" in printed
    assert "the settings as they stand" in printed.splitlines()[0]


def test_a_study_that_goes_on_is_one_that_was_left_alone(tmp_path, runs):
    made_up_study(tmp_path / "whole", TASK, 16)
    n_runs = len(runs.runs)
    for trials in (1, 5, 16, 16):
        made_up_study(tmp_path / "parts", TASK, trials)
    assert told(tmp_path / "parts") == told(tmp_path / "whole")
    assert len(runs.runs) == 2 * n_runs, "nothing is done twice"


def test_an_interrupted_trial_is_begun_again_and_keeps_the_runs_that_it_has(tmp_path, runs):
    made_up_study(tmp_path / "whole", TASK, 3)
    n_runs = len(runs.runs)
    runs.raises = {n_runs + 2: KeyboardInterrupt()}
    with pytest.raises(KeyboardInterrupt):
        made_up_study(tmp_path / "cut", TASK, 3)
    printed = made_up_study(tmp_path / "cut", TASK, 3)
    assert "trial   0              died with its process; it is begun again" in printed
    assert told(tmp_path / "cut") == told(tmp_path / "whole")
    assert len(runs.runs) == 2 * n_runs + 1, "the run that was broken off is the only one that is made again"
    assert findings_of(tmp_path / "cut", TASK).begun_again == 1


def test_a_trial_that_kills_its_process_is_given_up_in_the_end(tmp_path, runs):
    made_up_study(tmp_path, TASK, 1)
    for _ in range(3):
        with Book(tmp_path, TASK) as killed:
            assert killed.next_trial(2) is not None
    with Book(tmp_path, TASK) as book:
        assert book.next_trial(2) is None
    last = findings_of(tmp_path, TASK).tried[-1]
    assert (last.state, last.fault) == (FAILED, "its process died 3 times")
    assert len(runs.runs) == 2


def test_a_living_process_keeps_its_trial(tmp_path, runs):
    made_up_study(tmp_path, TASK, 1)
    with Book(tmp_path, TASK) as one, Book(tmp_path, TASK) as other:
        assert one.next_trial(3).number == 1
        assert other.next_trial(3).number == 2
        with Book(tmp_path, TASK) as third:
            assert third.next_trial(3) is None
    assert len(runs.runs) == 2


@pytest.mark.parametrize("fault", [UserError("the environment fell over"), RunFaultError("it broke")])
def test_a_trial_that_fails_is_told_and_the_others_go_on(tmp_path, runs, fault):
    runs.raises = {3: fault}
    assert f"failed: {fault}" in made_up_study(tmp_path, TASK, 3)
    assert told(tmp_path)[1][0] == FAILED


@pytest.mark.parametrize("fault", [ConfigError("ge.max_env_steps is small"), RunFaultError("it broke")])
def test_where_the_settings_as_they_stand_cannot_run_nothing_is_tuned(tmp_path, runs, fault):
    runs.raises = {1: fault}
    for _ in range(2):
        with pytest.raises(UserError, match=f"where the settings as they stand cannot run: {fault}"):
            made_up_study(tmp_path, TASK, 3)
    assert len(runs.runs) == 1
    assert forget_failed(tmp_path), "the same command begins anew"
    made_up_study(tmp_path, TASK, 3)
    assert not forget_failed(tmp_path)
    assert len(told(tmp_path)) == 3


@pytest.mark.usefixtures("runs")
def test_what_a_kill_leaves_of_a_line_or_a_lock_is_mended(tmp_path):
    made_up_study(tmp_path, TASK, 2)
    before = told(tmp_path)
    with (tmp_path / JOURNAL).open("ab") as file:
        file.write(b'{"op_code": 4, "wor')
    (tmp_path / f"{JOURNAL}.lock").symlink_to(tmp_path / JOURNAL)
    started = time.monotonic()
    made_up_study(tmp_path, TASK, 3)
    assert time.monotonic() - started < 20, "Optuna alone would wait for half a minute"
    assert told(tmp_path)[:2] == before
    assert len(told(tmp_path)) == 3


@pytest.mark.usefixtures("runs")
def test_a_default_outside_of_its_range_runs_all_the_same(tmp_path):
    task = small_task(texts=("ge.tournament_size=4..9", "ge.gene_probability"))
    made_up_study(tmp_path, task, 4)
    first, *others = findings_of(tmp_path, task).tried
    assert first.values["ge.tournament_size"] == 2
    assert all(4 <= one.values["ge.tournament_size"] <= 9 for one in others)


def test_a_journal_of_something_else_is_told_of(tmp_path):
    (tmp_path / JOURNAL).write_text("no journal\nat all\n")
    with pytest.raises(ArtefactError, match="must be a journal of Optuna"):
        findings_of(tmp_path, TASK)


class TestTask:
    def test_it_is_read_as_it_was_written(self, tmp_path):
        assert read_task(tmp_path) is None
        write_task(tmp_path, TASK)
        assert read_task(tmp_path) == TASK

    @pytest.mark.parametrize("text", ["[]", "{}", "{", '{"space": [1]}'])
    def test_another_file_is_told_of(self, tmp_path, text):
        (tmp_path / "tuning.json").write_text(text)
        with pytest.raises(ArtefactError, match=r"tuning\.json must be what tune writes"):
            read_task(tmp_path)

    def test_another_study_is_refused(self, tmp_path):
        check_same(tmp_path, TASK, small_task())
        for other, name in (
            (small_task(runs=5), "--seeds"),
            (small_task(texts=("ge.parsimony",)), "--space"),
        ):
            with pytest.raises(ConfigError, match=f"differs in {name}"):
                check_same(tmp_path, other, TASK)
        with pytest.raises(ConfigError, match=r"differs in the settings.*ge\.generations=3.* --seeds \d+\)"):
            check_same(tmp_path, small_task(seed=4), TASK)
        with pytest.raises(ConfigError, match="differs in the settings"):
            check_same(tmp_path, small_task(texts=("ge.parsimony",), seed=4), TASK)


class TestRuns:
    def test_no_episode_is_one_of_a_test(self, monkeypatch):
        purposes = []

        def noted(purpose, n, rng):
            purposes.append(purpose)
            return episode_seeds(purpose, n, rng)

        monkeypatch.setattr(fitness, "episode_seeds", noted)
        monkeypatch.setattr("ge_torchrl.tuning.task.episode_seeds", noted)
        asked = []
        config = small_task().with_values({"refiner.method": "none", "evaluation.test_episodes": 20})
        outcome = objective.outcome_of(config, lambda value: bool(asked.append(value)))
        assert set(purposes) == {"training", "validation"}
        assert outcome.value > 0
        assert outcome.env_steps <= 100_000
        assert len(asked) <= 1
        seeds = tuning_seeds(config)
        assert all(int(seed) in EPISODE_SEEDS["validation"] for seed in seeds)
        assert not set(seeds) & set(fitness.validation_seeds(config))

    def test_a_run_that_is_not_worth_it_ends_on_its_way(self):
        small = {"refiner.method": "none", "polish.every": 0, "archive.episodes": 10, "ge.generations": 1000}
        config = small_task().with_values(small)
        with pytest.raises(objective.EndedEarlyError):
            objective.outcome_of(config, lambda _value: True)


def test_two_processes_share_a_study(tmp_path, capfd):
    task = small_task(runs=1)
    task = type(task)(task.with_values({"refiner.method": "none", "polish.every": 0}), task.space, 1, ())
    write_task(tmp_path, task)
    work(tmp_path, 5, 2, Console(quiet=True))
    findings = findings_of(tmp_path, task)
    assert [one.number for one in findings.tried] == [0, 1, 2, 3, 4]
    assert findings.count(COMPLETE) + findings.count(ENDED) == 5
    printed = capfd.readouterr()
    assert printed.err == ""
    assert printed.out.count("trial ") == 5
