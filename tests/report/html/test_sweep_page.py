"""The page of a sweep never averages different settings together, and names every job that is in no figure."""

import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from records_for_tests import kept
from sweeps_for_tests import write_run

from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.report.html.sweep_page import groups_of, sweep_page
from ge_torchrl.report.html.writing import write_pages
from ge_torchrl.report.jobs import unfinished_jobs
from ge_torchrl.report.pages import write_report
from ge_torchrl.report.runs import read_runs
from ge_torchrl.report.settings import differing, labels_of


@pytest.fixture
def sweep(tmp_path):
    """Two seeds of each of two settings, a failed job, one that goes on, and one that left nothing."""
    folder = tmp_path / "sweep"
    number = 0
    for generations, mean in ((100, 480.0), (200, 100.0)):
        for seed in (0, 1):
            write_run(
                folder / f"{number}_seed={seed}", seed=seed, settings={"generations": generations},
                test_mean=mean + seed, solved=mean > 475, archive=[kept(1, 50.0), kept(3, mean)],
            )  # fmt: skip
            number += 1
    for name in ("4_failed", "5_open"):
        (write_run(folder / name) / "summary.json").unlink()
    (folder / "4_failed" / "traceback.txt").write_text("Traceback\nValueError: <b>no</b>\n")
    (folder / "8_seed=7").mkdir()
    write_run(folder / "7_seed=9", seed=9, settings={"generations": 100}, test_mean=490.0)
    return folder


def text_of(page):
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", page.partition("<body>")[2]))


def test_settings_are_told_apart(sweep):
    keys, groups = groups_of(read_runs(sweep).runs)
    assert keys == ["ge.generations"]
    assert {group.label: [run.seed for run in group.runs] for group in groups} == {
        "ge.generations=100": [0, 1, 9],
        "ge.generations=200": [0, 1],
    }
    text = text_of(sweep_page(sweep, read_runs(sweep)))
    assert f"ge.generations=100 3 3 of 3 (44% to 100%) {np.mean([480, 481, 490]):.2f}" in text
    assert "ge.generations=200 2 0 of 2 (0% to 66%) 100.50" in text
    assert "5 runs, which differ in ge.generations." in text


def test_whatever_differs_is_found_but_seed_and_measured_speed(sweep):
    configs = [run.config for run in read_runs(sweep).runs]
    one = configs[0]
    assert differing([one, replace(one, seed=7)]) == []
    faster = replace(one, evaluation=replace(one.evaluation, steps_per_second=2e8))
    assert differing([one, faster]) == []
    assert differing([one, replace(one, ge=replace(one.ge, wraps=1))]) == ["ge.wraps"]
    bnf = replace(one, grammar=replace(one.grammar, bnf="<dt> ::= <leaf>\n<leaf> ::= a"))
    assert differing([one, bnf, replace(bnf, env=replace(one.env, kwargs={"gravity": 2}))]) == [
        "grammar.bnf",
        "env.kwargs.gravity",
    ]


def test_budgets_that_follow_the_measured_speed_are_no_difference(sweep):
    left_open = replace(
        read_runs(sweep).runs[0].config, ge=replace(read_runs(sweep).runs[0].config.ge, max_env_steps=None)
    )
    slow, slower = (left_open.resolved(speed) for speed in (20_000.0, 23_000.0))
    assert slow.ge.max_env_steps != slower.ge.max_env_steps
    assert differing([slow, slower]) == []
    asked = replace(slow, ge=replace(slow.ge, max_env_steps=1234))
    assert differing([slow, asked]) == ["ge.max_env_steps"]
    assert labels_of([slow, slower, asked]) == [*["ge.max_env_steps=by speed"] * 2, "ge.max_env_steps=1234"]
    # A number that somebody typed may be what the speed gives, by chance.
    typed = replace(slower, ge=replace(slower.ge, max_env_steps=slow.ge.max_env_steps))
    assert labels_of([slow, typed]) == ["", ""]


def test_long_values_are_told_apart_by_all_of_them(tmp_path):
    for seed in (0, 1):
        path = write_run(tmp_path / str(seed), seed=seed)
        values = yaml.safe_load((path / "config.yaml").read_text())
        values["grammar"]["bnf"] = "<dt> ::= " + "leaf | " * 50 + f"leaf{seed}"
        (path / "config.yaml").write_text(yaml.safe_dump(values))
    runs = read_runs(tmp_path).runs
    _, groups = groups_of(runs)
    assert len(groups) == 2
    assert groups[1].label == f"{groups[0].label} (another, 2)"
    assert [run.setting for run in runs] == [group.label for group in groups]


def test_the_report_in_markdown_tells_settings_apart_too(tmp_path):
    pytest.importorskip("matplotlib")
    for number, generations in enumerate((100, 100, 200)):
        write_run(tmp_path / str(number), seed=number, settings={"generations": generations})
    text = write_report(tmp_path, None, tmp_path / "report").read_text()
    assert "### CartPole-v1: GE, ge.generations=100\n" in text
    assert "### CartPole-v1: GE, ge.generations=200\n" in text
    assert "### CartPole-v1: GE\n" not in text


def test_versions_are_told_apart(tmp_path):
    for seed, version in ((0, "0.1.0"), (1, "0.2.0")):
        write_run(tmp_path / str(seed), seed=seed, version=version)
    assert [group.label for group in groups_of(read_runs(tmp_path).runs)[1]] == [
        "version 0.1.0",
        "version 0.2.0",
    ]


def test_jobs_that_are_in_no_figure_are_named(sweep):
    jobs = {job.name: (job.state, job.told) for job in unfinished_jobs(sweep)}
    assert jobs["4_failed"] == ("failed", "ValueError: <b>no</b>")
    assert jobs["5_open"][0] == "stopped"
    assert jobs["5_open"][1].startswith("2 generations in")
    assert jobs["job 6"][0] == "missing"
    assert jobs["8_seed=7"][0] == "missing"
    assert len(jobs) == 4
    page = sweep_page(sweep, read_runs(sweep))
    assert "5 finished runs ; 3 of 5 solved their task; 1 job failed; 3 jobs not finished" in text_of(page)
    assert "ValueError: &lt;b&gt;no&lt;/b&gt;" in page


def test_runs_that_cannot_be_read_are_named(sweep):
    (sweep / "0_seed=0" / "best_tree.json").write_text("{}")
    text = text_of(sweep_page(sweep, read_runs(sweep)))
    assert "1 run could not be read" in text
    assert "unreadable" in text


def test_a_run_leads_to_its_page(sweep):
    pages = write_pages(sweep, read_runs(sweep))
    assert pages.written == sweep / "report.html"
    assert pages.failed == ()
    assert 'href="0_seed%3D0/report.html"' in pages.written.read_text()
    alone = sweep / "0_seed=0"
    assert write_pages(alone, read_runs(alone)).written == alone / "report.html"
    assert "ge_torchrl run" in (alone / "report.html").read_text()


def test_a_run_is_named_by_the_number_of_its_job(tmp_path):
    for number in (0, 1):
        write_run(tmp_path / f"{number}_env=cartpole,seed={number}", seed=number)
    page = sweep_page(tmp_path, read_runs(tmp_path))
    assert '<span class="folder" title="1_env=cartpole,seed=1">1</span>' in page
    write_run(tmp_path / "1_other", seed=2)
    assert ">1_env=cartpole,seed=1</span>" in sweep_page(tmp_path, read_runs(tmp_path))


def test_equal_artefacts_give_equal_pages(sweep):
    assert sweep_page(sweep, read_runs(sweep)) == sweep_page(sweep, read_runs(sweep))


def test_a_broken_job_without_history(tmp_path):
    path = write_run(tmp_path / "0")
    (path / "summary.json").unlink()
    (path / "history.jsonl").write_text("")
    assert RunFolder(path).read_history() == []
    assert [job.told for job in unfinished_jobs(tmp_path)] == ["no generation is written yet"]


def test_few_runs_have_a_range_and_no_bar(tmp_path):
    for seed in range(5):
        write_run(tmp_path / str(seed), seed=seed, test_mean=100.0 * seed)
    runs = read_runs(tmp_path)
    page = sweep_page(tmp_path, runs)
    assert 'class="band"' in page
    assert "(range " not in page
    page = sweep_page(tmp_path, runs._replace(runs=runs.runs[:3]))
    assert 'class="band"' not in page
    assert "100.00 (range 0.00 to 200.00)" in page
    assert "95 % interval of the mean" not in page
